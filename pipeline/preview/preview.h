// SPDX-License-Identifier: GPL-3.0-or-later
// Computes the data of `trocar-mesh preview`: some slices with the outlines that trocar-mesh would
// mesh with the same options, a histogram of the slices' values, and the areas that the material
// would have at other thresholds.
#pragma once

#include <cstdint>
#include <map>
#include <string>
#include <vector>

#include "pipeline/bake/mesh_stack.h"

namespace trocar::pipeline {

/// The patient directions towards the four edges of the image, as letters R, L, A, P, I, S. The
/// first letter names the patient axis nearest to the direction. The letter of another axis follows
/// if the direction leaves the plane perpendicular to that axis by at least 15 degrees. Example:
/// "LP" is a direction to the left that is also inclined to the back.
struct EdgeLetters {
  std::string left, right, top, bottom;
};

struct PreviewSlice {
  int index = 0;
  SlicePlane plane;
  Pixels pixels;  ///< pixels within Preview::crop, of the kind that the segmentation needs
  Pslg contours;  ///< the contours that trocar-mesh would simplify and mesh
  double area_mm2 = 0;
  /// Empty for image files, which do not state their orientation.
  EdgeLetters letters;
};

/// The material that all slices shown would have together, if the threshold were changed by
/// `change`. With equalisation (--equalize), the grey level that serves as the threshold is
/// changed. The material is computed as for an asset, except that solid bone (segment/solid_bone.h)
/// is not made and the scanner's table is not removed.
struct Change {
  /// `threshold` is the changed threshold or level, `area_mm2` the area of the material.
  double change = 0, threshold = 0, area_mm2 = 0;
  std::size_t outlines = 0;  ///< number of rings
};

struct Histogram {
  double low = 0, width = 1;  ///< lower end of the first bin; width of each bin
  /// Number of pixels in the slices shown, for each bin. The first bin also counts all lower
  /// values, the last bin all higher ones.
  std::vector<std::int64_t> counts;
};

struct Preview {
  PixelUnit unit = PixelUnit::kHounsfield;
  Segmentation segmentation;
  Lattice lattice;
  Crop crop;                              ///< region of each slice that is read
  int slices = 0, width = 0, height = 0;  ///< size of the scan in slices and pixels
  double step_mm = 0;                     ///< mean distance between the scan's slices
  /// Number of slices that were inspected at first, to find the first and the last slice with
  /// material (make_preview()); 0 if all slices were inspected.
  int inspected = 0;
  std::vector<PreviewSlice> shown;
  double low = 0, high = 0;  ///< range of the values in the slices shown
  /// Used only with equalisation, where one level stands for a different value in each slice. Each
  /// slice shown has a lowest value that is still material. `lowest_cut` is the smallest of these
  /// values, `highest_cut` the largest. If no slice has material, lowest_cut > highest_cut.
  double lowest_cut = 0, highest_cut = 0;
  Histogram histogram;          ///< empty for labels
  std::vector<Change> changes;  ///< five, of which the third has change 0; empty for labels
  /// Number of voxels of each label in the slices shown. The map has each label that occurs in
  /// these slices, except the label 0. It also has each label that is material; if such a label
  /// does not occur, its number is 0. If a slice has more than 4096 labels, some that are not
  /// material are not counted, and there is the warning labels_not_counted.
  std::map<int, std::int64_t> label_voxels;
  bool has_solid = false;  ///< true: trocar-mesh would make solid bone (segment/solid_bone.h)
  bool has_table = false;  ///< true: a scanner's table was found and left out
  bool is_filled = false;  ///< true: the inside of the bone is filled (SolidOptions::fill_mm2)
  std::vector<Warning> warnings;
};

/// Previews `count` slices, evenly spread from the first to the last slice with material. A slice
/// between these two is shown even if it is empty. If the scan has more than 64 slices, only 64 of
/// them are inspected at first, so that not all slices need to be read. The first slice with
/// material is then found by bisection between the first inspected slice with material and the
/// inspected slice before it. The last slice with material is found likewise. (Material outside the
/// range that is found can be missed, if it lies in a few slices between two empty inspected
/// slices; size_text() says so.) All slices are read in three cases: if solid bone is made, if
/// ScannerTable::find() finds a scanner's table in the few slices that it reads first, or if none
/// of the 64 slices has material. The number of threads does not change the result. Errors: those
/// that mesh_stack() can find before it simplifies contours.
Result<Preview> make_preview(const SliceStack& stack, const StackOptions& options, int count);

/// The unit of the values, in words: "HU", "grey levels", "labels", or "values" if uncalibrated.
std::string unit_name(const Preview& preview);

// The sentences and numbers of a preview, for its picture and its page. Nothing in them comes from
// names or texts of the input, because such texts may identify the patient.

/// Kind of the input: "DICOM", "NIfTI", "NRRD" or "images".
std::string input_kind(const SliceStack& stack);

/// Title of the sheet: the kind of input and the number of slices shown.
std::string sheet_title(const SliceStack& stack, const Preview& preview);

/// The options that determine the material, in words.
std::string options_text(const StackOptions& options, const OpenOptions& input, PixelUnit unit);

/// A phrase for sentences: "the slice shown" or "the N slices shown".
std::string slices_shown(const Preview& preview);

/// The sizes of the scan and of `view`, the region shown. If not all slices were inspected, the
/// text says that material beyond the slices shown can be missing.
std::string size_text(const Preview& preview, const Crop& view);

/// The preview's warnings, each once, without file names. A sentence that may contain names or
/// texts of the input is replaced by one that refers to the messages on the terminal.
std::vector<Warning> shown_warnings(const Preview& preview);

/// Says which contours the numbers in Preview::changes include. If the bone is filled, also says
/// how much of a vertebra or a rib is usually covered by filled bone.
std::string changes_text(const Preview& preview);

/// A number with up to `digits` significant digits. If its integer part has more digits, the number
/// is rounded to an integer instead.
std::string number_text(double value, int digits = 4);

}  // namespace trocar::pipeline
