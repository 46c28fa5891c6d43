"""The simulated world: MuJoCo's scene from the task, with contacts of calibrated stiffness."""
