"""Exports laws and state machines to C, FMI, SCXML and Mermaid."""
