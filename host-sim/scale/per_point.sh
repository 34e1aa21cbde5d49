#!/usr/bin/env bash
# Of the seconds that so many points took, the share of each, in milliseconds of a core.
awk -v seconds="$1" -v points="$2" -v cores="$(nproc)" 'BEGIN { printf "%.2f ms of a core", seconds * cores / points * 1e3 }'
