"""How the equations are solved: parameters and time integration schemes."""
