"""Block diagrams and state charts as pictures (SVG) and as Mermaid text."""
