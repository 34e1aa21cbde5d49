#!/usr/bin/env bash
# Core time per point in milliseconds, from the number of points and the seconds for all.
awk -v seconds="$1" -v points="$2" -v cores="$(nproc)" 'BEGIN { printf "%.2f ms of a core", seconds * cores / points * 1e3 }'
