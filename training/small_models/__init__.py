"""The library of the training scripts: crops, captions, losses and steps."""
