"""Methods of others on the same data, the paper's tables, and speed against accuracy. egosplat never imports it."""
