"""The blocks: every block of the papers' figures as one Drake system with named ports."""
