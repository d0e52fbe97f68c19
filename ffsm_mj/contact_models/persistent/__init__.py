"""Contact that lasts: pushing, resting, sliding, held exactly by the accelerations of its gaps."""
