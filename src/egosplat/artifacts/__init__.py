"""Artifacts: Zarr v3 groups that are written whole, read with checks, and know how they were made.

An artifact is one folder, described by a ``Schema``; no module outside this room opens Zarr. What each kind
holds stands in a module of its own, so that a new kind changes the code of no stage that does not use it.

Attributes: one dictionary under ``"egosplat"``: schema name and format version, ``digest`` (SHA-256 over
the stored arrays), ``provenance`` (how it was made), ``facts`` (small results that are no arrays), and
``seal`` (SHA-256 over all the others).
"""
