"""The papers' printed results, each with its source."""
