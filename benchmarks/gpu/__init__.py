"""Agreement of the rasterizer on a GPU with the reference."""
