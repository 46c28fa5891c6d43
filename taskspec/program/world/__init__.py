"""What the controller believes of the world: frames, surfaces, equations, mechanisms."""
