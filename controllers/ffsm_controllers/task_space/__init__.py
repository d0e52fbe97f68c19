"""Control laws on the output of the task: position of the tip, and its attitude."""
