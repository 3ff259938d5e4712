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
  std::size_t broken = 0;                    ///< number of unusable files that should have been
                                             ///< slices
  std::size_t localisers = 0;                ///< number of localiser files
  /// Broken slices are included, so that a damaged scan is still preferred to a smaller series.
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
/// Errors: (usage) `wanted` names no series, or several.
Result<std::string> named_series(const std::vector<DicomSeries>& series, const std::string& wanted);

struct ChosenSeries {
  std::size_t index = 0;
  std::string why;  ///< reason, such as "the only CT series"; empty if there is no other
};

/// Chooses the series with this UID. If `uid` is empty, chooses the series with the most images,
/// and any CT series before others; of several with equally many images, the first. `series` must
/// not be empty. Errors: (refused) there are only localisers.
Result<ChosenSeries> choose_series(const std::vector<DicomSeries>& series, const std::string& uid,
                                   const std::string& where);

/// The name of a series in messages, such as "3 'Bone H60s'"; its UID if it has neither number nor
/// description.
std::string series_name(const SeriesInfo& series);

/// The slices of the chosen series. Warnings: other_series, no_rescale. Errors (refused): one of
/// its files cannot be used, or lacks a rescale that others have.
Result<std::vector<DicomFrame>> slices_of(const std::vector<DicomSeries>& series,
                                          const ChosenSeries& chosen, const std::string& where,
                                          std::vector<Warning>& warnings);

/// The shape of a stack of sorted slices.
StackShape stack_shape(const std::vector<DicomFrame>& slices);

/// Sorts slices by position along the first slice's normal (ascending). Errors: (refused) size,
/// orientation, pixel spacing or frame of reference differ, or two slices with the same position
/// differ in a pixel; the message names both files. Of two slices with the same position and equal
/// pixels, one is kept (warning copied_slice). Other warnings: missing_slice, uneven_spacing,
/// gantry_tilt, tilt_contradiction, dense_padding.
Result<void> sort_and_check(std::vector<DicomFrame>& slices, std::vector<Warning>& warnings);

}  // namespace trocar::pipeline
