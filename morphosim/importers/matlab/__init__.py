"""Files of the published MATLAB program."""
