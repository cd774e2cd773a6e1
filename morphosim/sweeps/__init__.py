"""Scans of parameters: many runs of one scene, one Dataset.

`axes` says which members a scan has, `figures` what is taken of each, `members` runs one,
`scheduler` hands them to Dask, `store` keeps what is finished, `result` puts it together.
"""
