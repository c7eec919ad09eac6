"""The peg and the hole: dimensions, presets, surfaces, collision geometry and support."""
