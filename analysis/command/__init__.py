"""Runs the commands: experiments, their output folders and their printed text."""
