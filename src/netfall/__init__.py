"""netfall: form finding, load analysis and collapse of cable roofs by the finite particle
method, on MPI ranks.

The work in order: a **job** (what was asked), a **net** (nodes, cables, supports), its **mechanics**
(elements, steps, fracture, energy), the **wind**, the **parallel** split, the **solve** (form finding,
statics, dynamics), the **output** (result file, pictures). Imports run from left to right of that line.
"""

__version__ = "0.1.0"
