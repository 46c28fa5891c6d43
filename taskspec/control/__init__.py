"""The laws as equations, on CasADi expressions, and their resolution into joint torques."""
