"""How the implicit part of a step is solved: cosine transforms, or iterations on the band."""
