"""The one-axis servo loops of the first paper: FSM against PID."""
