"""What a log of a robot tells of its sensor, tool, impedance, contact and joints."""
