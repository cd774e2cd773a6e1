"""A plain full-grid solution of the published scheme, and checks of it."""
