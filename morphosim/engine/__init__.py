"""The state of all cells and the step that advances it; knows no scene."""
