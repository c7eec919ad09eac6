"""From a law to a robot: the guard around its commands, the loop that runs it, adapters."""
