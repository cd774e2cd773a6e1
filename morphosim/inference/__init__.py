"""From images to mechanics: tensions and attractions with which cells stay as they are seen."""
