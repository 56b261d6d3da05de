"""Tests of egosplat; ``tests.support`` holds what several of them use."""
