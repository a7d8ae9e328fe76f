#!/usr/bin/env bash
# The whole path on the simulated phantom: train, segment an unseen sweep, register, track, report.
set -euo pipefail
cd "$(dirname "$0")/.."
ctus=.venv/bin/ctus
out=outputs/demo
mkdir -p "$out"

# Runs a command with its progress on the terminal and its closing lines kept for the end.
step() {
  local log=$1
  shift
  "$ctus" "$@" >"$out/$log" || { cat "$out/$log"; exit 1; }
}

echo "1/3  Training a U-Net on simulated frames, fold by fold"
step segmentation.txt study=segmentation dataset=phantom dataset.sweeps=3 dataset.frames_per_sweep=20 trainer=demo out=$out/segmentation

echo "2/3  Segmenting a sweep that no network has seen, and placing its contours in the world"
step pipeline.txt study=pipeline phantom=artery model_path="$out/segmentation/fold-0/model.pt" out=$out/pipeline

echo "3/3  Registering that cloud to the phantom's model, single start against multi-start"
step robustness.txt -m study=robustness target=$out/pipeline/model.ply moving=$out/pipeline/cloud.ply \
  moving_truth=$out/pipeline/truth.json "overlaps=[1.0]" trials=10 \
  perturbation.angle_max_deg=45,90,180 out=$out/robustness

echo
.venv/bin/python scripts/demo_summary.py "$out"
echo "All numbers are of simulated data; $out/summary.md has all of them."
echo "Open:      $out/pipeline/scene.html"
echo "Dashboard: .venv/bin/$(sed -n 's/^Dashboard: //p' "$out/robustness.txt")"
