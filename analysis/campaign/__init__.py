"""Trials: run on workers or a cluster, stored one by one, resumed."""
