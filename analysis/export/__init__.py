"""Laws and charts for where no Python is: C, FMI, SCXML and Mermaid."""
