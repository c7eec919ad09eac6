"""Linear models of diagrams for python-control, and its systems as blocks."""
