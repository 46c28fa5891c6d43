"""The nominal trajectory of a task: where tool and arm are in each stage, and from which start."""
