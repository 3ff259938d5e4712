// SPDX-License-Identifier: GPL-3.0-or-later
// Groups DICOM images into series, chooses one series as the scan, and puts its slices in order.
// Tests: tests/pipeline/read/readers_test.cpp, tests/e2e/studies_e2e_test.py
#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "formats/base/result.h"
#include "pipeline/read/dicom/dicom_headers.h"
#include "pipeline/read/slice_stack.h"
#include "pipeline/read/stack_shape.h"

namespace trocar::pipeline {

/// The slices and the files of a series.
struct DicomSeries {
  /// Attributes of the first slice's file. `info.uid` is never empty: if the file states no UID,
  /// one is made from other attributes (SeriesInfo::uid).
  SeriesInfo info;
  ImageContent content;  ///< kind of the images in the first slice's file, such as CT or localiser
  std::vector<DicomFrame> slices;
  std::vector<std::filesystem::path> files;  ///< all files: slices, localisers, unusable files
  std::string problem;                       ///< message about the first of the `unusable` files
  std::size_t unusable = 0;  ///< number of unusable files, counting segmentations as unusable
  /// Number of unusable files that should have been slices (broken slices).
  std::size_t broken = 0;
  std::size_t localisers = 0;  ///< number of localiser files
  /// The number of slices including the broken ones. choose_series() compares this number, so that
  /// it prefers a damaged scan to an intact but smaller one.
  std::size_t images() const { return slices.size() + broken; }
  bool is_localiser() const { return localisers > 0 && images() == 0; }
};

/// Groups files into series. The series are ordered by number and then by UID; series without a
/// number come last. Images without a series UID are grouped by frame of reference, orientation and
/// size. Warnings: not_dicom, localiser, no_series_uid, no_sop_uid.
std::vector<DicomSeries> group_series(const std::vector<DicomFile>& files,
                                      std::vector<Warning>& warnings);

/// The UID of the series that `wanted` names. `wanted` is compared with all UIDs, then with all
/// numbers, then with all complete descriptions. If `wanted` is not a number, a last comparison is
/// with parts of descriptions, without regard to upper and lower case. The first of these
/// comparisons that matches a series counts. Errors: kUsage if `wanted` names no series or several.
Result<std::string> named_series(const std::vector<DicomSeries>& series, const std::string& wanted);

struct ChosenSeries {
  std::size_t index = 0;  ///< index in the argument `series` of choose_series()
  std::string why;  ///< reason, such as "the only CT series"; empty if there was nothing to choose
};

/// Chooses the series with the UID `uid`. If `uid` is empty, chooses among the series whose
/// DicomSeries::images() is not 0, by these rules in turn:
///  1. A CT series is preferred to any other. Next comes a series without a modality.
///  2. A series with a larger DicomSeries::images() is preferred.
///  3. A series that comes earlier in `series` is preferred.
/// If images() is 0 for all series, the first series that is not a localiser is chosen. `where`
/// names the input in messages. Precondition: `series` is not empty. Errors: kRefused if the chosen
/// series is a localiser, or if there are only localisers.
Result<ChosenSeries> choose_series(const std::vector<DicomSeries>& series, const std::string& uid,
                                   const std::string& where);

/// The name of a series in messages, such as "3 'Bone H60s'"; its UID if it has neither number nor
/// description.
std::string series_name(const SeriesInfo& series);

/// The slices of the chosen series, not yet sorted. `where` names the input in messages. Warnings:
/// other_series, no_rescale. Errors: kRefused if a file of the series cannot be used, or if a slice
/// lacks the rescale that other slices of the series have.
Result<std::vector<DicomFrame>> slices_of(const std::vector<DicomSeries>& series,
                                          const ChosenSeries& chosen, const std::string& where,
                                          std::vector<Warning>& warnings);

/// The distances, shift and tilt of slices that sort_and_check() has sorted.
StackShape stack_shape(const std::vector<DicomFrame>& slices);

/// Sorts slices by their position along the normal of `slices[0]`, in ascending order. If two
/// slices have the same position and equal pixels, one of them is removed (warning copied_slice).
/// Other warnings: missing_slice, uneven_spacing, gantry_tilt, tilt_contradiction, dense_padding.
/// Errors: kRefused if a slice differs from `slices[0]` in size, orientation, pixel spacing or
/// frame of reference, or if two slices with the same position differ in a pixel. The message names
/// both files.
Result<void> sort_and_check(std::vector<DicomFrame>& slices, std::vector<Warning>& warnings);

}  // namespace trocar::pipeline
