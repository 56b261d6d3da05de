#!/bin/sh
# Install egosplat from this folder, for both recipes: install.sh cpu|cuda EXTRA. As root, on Debian or Ubuntu.
set -eu
cd "$(dirname "$0")/.."
export DEBIAN_FRONTEND=noninteractive
apt-get update
apt-get install --yes --no-install-recommends g++ git libgl1 libglib2.0-0 make python3 python3-dev python3-venv
rm -rf /var/lib/apt/lists/* .venv results logs .snakemake
make install TORCH="$1"
.venv/bin/python -m pip install --no-cache-dir --no-build-isolation --constraint requirements-dev.lock --editable ".[$2]"
