// SPDX-License-Identifier: GPL-3.0-or-later
// Groups DICOM images into series and chooses one series as the scan.
#pragma once

#include <cstddef>
#include <filesystem>
#include <string>
#include <vector>

#include "formats/base/result.h"
#include "pipeline/read/dicom/dicom_headers.h"
#include "pipeline/read/slice_stack.h"

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
  /// If several series with a part of one volume each are joined: the UIDs of all of them. Otherwise
  /// empty.
  std::vector<std::string> joined_uids;
  /// The number of slices including the broken ones. choose_series() compares this number, so that
  /// it prefers a damaged scan to an intact but smaller one.
  std::size_t images() const { return slices.size() + broken; }
  bool is_localiser() const { return localisers > 0 && images() == 0; }
};

/// Groups files into series. The series are ordered by number and then by UID; series without a
/// number come last. Images without a series UID are grouped by frame of reference, orientation and
/// size. Some scanners and exports give each slice, or each part of a scan, a series of its own.
/// Such series are joined (DicomSeries::joined_uids) if study, modality, frame of reference, kind of
/// image, kernel, description, orientation, size, pixel spacing and slice thickness agree, and if
/// their slices form one evenly spaced stack. Series of several slices must also have the same
/// number, and must not overlap. Warnings: not_dicom, localiser, no_series_uid, no_sop_uid.
std::vector<DicomSeries> group_series(const std::vector<DicomFile>& files,
                                      std::vector<Warning>& warnings);

/// The UID of the series (info.uid) that `wanted` names. `wanted` is compared with all UIDs, then with all
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
/// series is a localiser, or if there are only localisers; kRefused if `uid` is empty and the choice
/// would be one of several series that have a single slice each, as if they were parts of one scan
/// that could not be joined.
Result<ChosenSeries> choose_series(const std::vector<DicomSeries>& series, const std::string& uid,
                                   const std::string& where);

/// The slices of the chosen series, not yet sorted. `where` names the input in messages. Warnings:
/// other_series, joined_series, no_rescale. Errors: kRefused if a file of the series cannot be used, or if a slice
/// lacks the rescale that other slices of the series have.
Result<std::vector<DicomFrame>> slices_of(const std::vector<DicomSeries>& series,
                                          const ChosenSeries& chosen, const std::string& where,
                                          std::vector<Warning>& warnings);

// Joins series that have a part of one scan each.

}  // namespace trocar::pipeline
