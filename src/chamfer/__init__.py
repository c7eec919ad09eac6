"""Chamfer: three papers on compliant assembly as Drake blocks, diagrams and checked results.

The packages beside this file are the folders of the same names at the project's top.
"""
