"""The cost model: memory and time of each stage from the sizes of a scene.

``coefficients.json`` holds the only table of coefficients; ``python -m benchmarks.growth coefficients`` writes it. The cluster
profile (``requests``), ``egosplat doctor`` and docs/scale.md evaluate it.
"""
