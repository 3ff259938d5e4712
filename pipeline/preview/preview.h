// SPDX-License-Identifier: GPL-3.0-or-later
// Computes the data of `trocar-mesh preview`: some slices with the outlines that a run with the
// same options would mesh, the values in them, and the areas that other thresholds would give.
// Tests: tests/e2e/preview_test.py
#pragma once

#include <array>
#include <cstdint>
#include <map>
#include <string>
#include <vector>

#include "pipeline/scan/mesh_stack.h"

namespace trocar::pipeline {

/// The patient directions of the four edges of the image, as letters R, L, A, P, I, S. An edge
/// whose direction is oblique by more than 15 degrees has two or three letters. The texts are empty
/// if the input has no orientation.
struct EdgeLetters {
  std::string left, right, top, bottom;
};
EdgeLetters edge_letters(const SlicePlane& plane);

struct PreviewSlice {
  int index = 0;
  SlicePlane plane;
  Image image;    ///< pixels within the crop
  Pslg contours;  ///< the contours that a run would simplify and mesh
  double area_mm2 = 0;
  EdgeLetters letters;
};

/// The material in all slices shown, if the threshold or level were changed by `change`. It is
/// computed by the same stages as a run, but without solid bone and with the scanner's table.
struct Change {
  double change = 0, threshold = 0, area_mm2 = 0;
  std::size_t outlines = 0;
};

struct Histogram {
  double low = 0, width = 1;  ///< lower end of the first bin; width of each bin
  /// Number of pixels in the slices shown, for each bin. The first and the last bin include all
  /// values beyond the histogram.
  std::vector<std::int64_t> counts;
};

struct Preview {
  PixelUnit unit = PixelUnit::kHounsfield;
  Segmentation segmentation;
  Lattice lattice;
  Crop crop;                              ///< region of each slice that is read
  int slices = 0, width = 0, height = 0;  ///< size of the scan
  double step_mm = 0;                     ///< mean distance between the scan's slices
  std::vector<PreviewSlice> shown;
  double low = 0, high = 0;  ///< range of the values in the slices shown
  /// Minimum and maximum, over the slices shown, of the lowest value that is material. (With
  /// equalisation this value differs between slices.)
  double lowest_cut = 0, highest_cut = 0;
  Histogram histogram;          ///< empty for labels
  std::vector<Change> changes;  ///< empty for labels; the third one has change 0
  /// Number of voxels of each label: of all wanted labels, and of all others that occur, except 0.
  std::map<int, std::int64_t> label_voxels;
  bool has_solid = false;
  bool has_table = false;  ///< a scanner's table was found and left out
  bool is_filled = false;  ///< SolidOptions::fill_mm2 is given
  std::vector<Warning> warnings;
};

/// Previews `count` slices, evenly spread between the first and the last slice with material. In
/// scans of more than 64 slices, the first and the last one are found by bisection, so that only
/// the slices that are needed are read (all of them if there is solid bone). The number of threads
/// does not change the result. Errors: those of the first stages of mesh_stack().
Result<Preview> make_preview(const SliceStack& stack, const StackOptions& options, int count);

/// The unit of the values, in words: "HU", "grey levels", "labels", or "values" if uncalibrated.
std::string unit_name(const Preview& preview);

}  // namespace trocar::pipeline
