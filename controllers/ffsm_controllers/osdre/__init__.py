"""The output SDRE law and its Riccati solvers."""
