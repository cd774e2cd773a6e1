"""What acts on cells: parameters, and one file for each force term."""
