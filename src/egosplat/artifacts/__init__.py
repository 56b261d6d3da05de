"""Artifacts: Zarr v3 groups that are written whole, read with checks, and carry their provenance. An artifact
is one folder, described by a ``Schema``. No module outside this room opens Zarr. Its attributes, under
``"egosplat"``, are schema name and format version, ``digest`` (SHA-256 over the stored arrays),
``provenance``, ``facts`` (small results that are not arrays), and ``seal`` (SHA-256 over all other
attributes)."""
