"""Runs on disk: a directory of files that appear whole, so that a run survives being killed.

- `scene.toml` (and `scene.npz`): the scene; `morphosim run DIR/scene.toml` repeats the run.
- `save-000000.nc`, …: one netCDF file per save. Its root holds what is known per time and cell;
  `xr.open_mfdataset("DIR/save-*.nc")` makes one table of all. Its groups hold what has another
  length in every save: `fields`, `labels` and, beyond 500 cells, `contacts`.
- `restart-000007.npz`: the whole state at the last save, from which the run goes on bit for bit.
- `lock`: held while a process writes.

`measured_state` says what is measured at a save, `schema` what else files hold. A reader goes by
what the files say, so that it reads variables that it does not know: `reader.read_run` gives one
Dataset of all saves, `pack.pack` writes it into one file.
"""
