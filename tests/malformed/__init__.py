"""Files and values that are wrong by chance: each must end in one line that says so, or be right.

`inputs` holds what is sound, `mutations` what is done to it, `readers` who reads it, `outcome` what
came of it. `workers` tries inputs in a process of their own, as one may kill the interpreter.
`benchmarks/malformed.py` tries thousands; the tests a hundred of each.
"""
