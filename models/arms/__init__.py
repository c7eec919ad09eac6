"""The arms of the force-control experiments: kinematics and the URDF beside it."""
