"""What is modelled: cells, physics, numerics, confinement, stages; and the files that say it."""
