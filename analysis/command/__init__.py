"""What the commands do: running experiments, and what they print."""
