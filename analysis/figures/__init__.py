"""The figures: from traces and metrics to Matplotlib figures, never from a simulator."""
