// SPDX-License-Identifier: GPL-3.0-or-later
// Groups a folder's DICOM images into series, chooses the scan and puts its slices in order.
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

/// The files of a series.
struct DicomSeries {
  SeriesInfo info;       ///< attributes of the first slice's file; the UID is never empty
  ImageContent content;  ///< content of the first slice's file
  std::vector<DicomFrame> slices;
  std::vector<std::filesystem::path> files;  ///< slices, localisers and unusable files
  std::string problem;                       ///< message about the first unusable file
  std::size_t unusable = 0;                  ///< number of unusable files
  /// Number of unusable files that should have been slices (broken slices).
  std::size_t broken = 0;
  std::size_t localisers = 0;  ///< number of localiser files
  /// The number of slices. Broken ones count, so that a damaged scan is preferred to a smaller one.
  std::size_t images() const { return slices.size() + broken; }
  bool is_localiser() const { return localisers > 0 && images() == 0; }
};

/// Groups files into series. The series are ordered by number and then by UID; those without a
/// number come last. Images without a series UID are grouped by frame of reference, orientation and
/// size. Warnings: not_dicom, localiser, no_series_uid, no_sop_uid.
std::vector<DicomSeries> group_series(const std::vector<DicomFile>& files,
                                      std::vector<Warning>& warnings);

/// The UID of the series that `wanted` names. A series can be named by its UID, its number, its
/// complete description, or a part of its description, in which upper and lower case do not matter.
/// Errors: kUsage if `wanted` names no series or several.
Result<std::string> named_series(const std::vector<DicomSeries>& series, const std::string& wanted);

struct ChosenSeries {
  std::size_t index = 0;
  std::string why;  ///< reason, such as "the only CT series"; empty if there was nothing to choose
};

/// Chooses the series with this UID. If `uid` is empty, chooses by modality first: CT series are
/// preferred to those without a modality, and these to all other series. Of the preferred series,
/// the one with the most images is chosen, or the first of several with equally many. Precondition:
/// `series` is not empty. Errors: kRefused if the series is a localiser, or if there are only
/// localisers.
Result<ChosenSeries> choose_series(const std::vector<DicomSeries>& series, const std::string& uid,
                                   const std::string& where);

/// The name of a series in messages, such as "3 'Bone H60s'"; its UID if it has neither number nor
/// description.
std::string series_name(const SeriesInfo& series);

/// The slices of the chosen series. Warnings: other_series, no_rescale. Errors: kRefused if a file
/// of the series cannot be used, or lacks a rescale that other files of the series have.
Result<std::vector<DicomFrame>> slices_of(const std::vector<DicomSeries>& series,
                                          const ChosenSeries& chosen, const std::string& where,
                                          std::vector<Warning>& warnings);

/// The shape of a stack of sorted slices.
StackShape stack_shape(const std::vector<DicomFrame>& slices);

/// Sorts slices by position along the first slice's normal (ascending). Of two slices with the same
/// position and equal pixels, one is kept (warning copied_slice). Other warnings: missing_slice,
/// uneven_spacing, gantry_tilt, tilt_contradiction, dense_padding. Errors: kRefused if size,
/// orientation, pixel spacing or frame of reference differ, or if two slices with the same position
/// differ in a pixel; the message names both files.
Result<void> sort_and_check(std::vector<DicomFrame>& slices, std::vector<Warning>& warnings);

}  // namespace trocar::pipeline
