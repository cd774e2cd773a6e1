"""A scene on its way through time: steps, stages, events, observers."""
