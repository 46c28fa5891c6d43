"""The closed loop: what the robot senses, and the fixed-step loop around plant and controller."""
