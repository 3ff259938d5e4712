// SPDX-License-Identifier: GPL-3.0-or-later
// Which of a folder's DICOM images are the scan, and in which order.
#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "formats/base/result.h"
#include "pipeline/read/dicom_headers.h"
#include "pipeline/read/slice_stack.h"
#include "pipeline/read/stack_shape.h"

namespace trocar::pipeline {

/// The files of a series.
struct DicomSeries {
  SeriesInfo info;       ///< of its first slice's file; the UID is never empty
  ImageContent content;  ///< of the same
  std::vector<DicomFrame> slices;
  std::vector<std::filesystem::path> files;  ///< all: slices, localisers, unusable ones
  std::string problem;                       ///< of its first unusable file
  std::size_t unusable = 0;                  ///< files
  std::size_t broken = 0;                    ///< of those: what should have been slices
  std::size_t localisers = 0;                ///< files
  /// Broken slices count: a damaged scan is still chosen over a smaller series beside it.
  std::size_t images() const { return slices.size() + broken; }
  bool is_localiser() const { return localisers > 0 && images() == 0; }
};

/// By number, then UID; series without a number are the last. Images without a series UID are
/// grouped by frame of reference, orientation and size. Warnings: files that are not images.
std::vector<DicomSeries> group_series(const std::vector<DicomFile>& files,
                                      std::vector<Warning>& warnings);

/// The UID of the series that `wanted` names: by UID, number or description (as it is, else
/// case-insensitively a part of it). Errors: (usage) none, or several, are named so.
Result<std::string> named_series(const std::vector<DicomSeries>& series, const std::string& wanted);

struct ChosenSeries {
  std::size_t index = 0;
  std::string why;  ///< such as "the only CT series"; empty if there is no other
};

/// The one with this UID, or, if it is empty, the one with most images, of CT if any is; among
/// equals the first. Errors: (refused) only localisers. The list must not be empty.
Result<ChosenSeries> choose_series(const std::vector<DicomSeries>& series, const std::string& uid,
                                   const std::string& where);

/// As in "3 'Bone H60s'", or its UID.
std::string series_name(const SeriesInfo& series);

/// The chosen series' slices; warnings name its localisers and, if `why` says so, the other series.
/// Errors (refused): a file of it cannot be used, or lacks a rescale that others have.
Result<std::vector<DicomFrame>> slices_of(const std::vector<DicomSeries>& series,
                                          const ChosenSeries& chosen, const std::string& where,
                                          std::vector<Warning>& warnings);

/// Of sorted slices.
StackShape stack_shape(const std::vector<DicomFrame>& slices);

/// Sorts by position along the first one's normal (ascending). Errors (refused): size, orientation,
/// pixel spacing or frame of reference differ, or two at the same position: both files are named.
/// A file that is there twice, equal to the byte, is taken once (warning copied_slice). Other
/// warnings: missing_slice, uneven_spacing, gantry_tilt.
Result<void> sort_and_check(std::vector<DicomFrame>& slices, std::vector<Warning>& warnings);

}  // namespace trocar::pipeline
