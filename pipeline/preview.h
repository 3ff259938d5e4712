// SPDX-License-Identifier: GPL-3.0-or-later
// What `trocar-mesh preview` shows: some slices with the outlines that a run with the same options
// makes of them, what values they hold, and what another threshold would change.
#pragma once

#include <array>
#include <cstdint>
#include <map>
#include <string>
#include <vector>

#include "pipeline/batch.h"

namespace trocar::pipeline {

/// Letters of the directions that the image's edges face: R, L, A, P, I, S, two or three of them
/// where the edge is oblique by more than 15 degrees. Empty if the input has no orientation.
struct EdgeLetters {
  std::string left, right, top, bottom;
};
EdgeLetters edge_letters(const SlicePlane& plane);

struct PreviewSlice {
  int index = 0;
  SlicePlane plane;
  Image image;    ///< within the crop
  Pslg contours;  ///< as MeshedSlice::contours
  double area_mm2 = 0;
  EdgeLetters letters;
};

/// The material of all slices shown at another threshold or level, by the same stages but without
/// solid bone.
struct Change {
  double change = 0, threshold = 0, area_mm2 = 0;
  std::size_t outlines = 0;
};

struct Histogram {
  double low = 0, width = 1;  ///< of the first bin; of each bin
  /// Pixels of the slices shown; values beyond the ends are counted in the first and last bin.
  std::vector<std::int64_t> counts;
};

struct Preview {
  PixelUnit unit = PixelUnit::kHounsfield;
  Segmentation segmentation;
  Lattice lattice;
  Crop crop;                              ///< the part of each slice that is read
  int slices = 0, width = 0, height = 0;  ///< of the scan
  double step_mm = 0;                     ///< between the scan's slices, on average
  std::vector<PreviewSlice> shown;
  double low = 0, high = 0;  ///< values of the slices shown
  /// With equalisation: lowest value that is material, of the slice where it is lowest and of that
  /// where it is highest.
  double lowest_cut = 0, highest_cut = 0;
  Histogram histogram;                       ///< not of labels
  std::vector<Change> changes;               ///< not of labels; the third is no change
  std::map<int, std::int64_t> label_voxels;  ///< of labels: without 0, with all that are wanted
  bool has_solid = false;
  std::vector<Warning> warnings;
};

/// `count` slices, evenly spread between the first and the last that have material (of scans of
/// more than 64 slices these two are found by bisection). Reads no others than are needed for this,
/// apart from solid bone, which needs all. The same with any number of threads. Errors: those of
/// mesh_stack(), but without those of its later stages.
Result<Preview> make_preview(const SliceStack& stack, const BatchOptions& options, int count);

/// "HU", "grey levels", the modality's "values", or "labels".
std::string unit_name(const Preview& preview);

}  // namespace trocar::pipeline
