"""Where cells start and what confines them: shapes, walls, partitions, start fields."""
