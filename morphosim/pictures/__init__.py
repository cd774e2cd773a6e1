"""Pictures of runs: figures, films and pages that show the cells as surfaces.

- `meshes`: the surfaces that everything draws; `colours`, `palettes`: what colour each cell has.
- `plot`, `film`: figures and films, of `sight` (what is seen), `camera` (from where), `painter`
  (the pixels), and `name_tags`, `annotate`, `layout` (what is written on them, and where).
- `show`: a page with a view to turn, of `viewerdata` and `meshcode`.
"""
