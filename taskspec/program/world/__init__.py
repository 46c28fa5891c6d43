"""The nominal world: frames, surfaces, equations, mechanisms."""
