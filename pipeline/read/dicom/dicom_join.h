// SPDX-License-Identifier: GPL-3.0-or-later
// Joins series that have a part of one scan each.
#pragma once

#include <cstddef>
#include <string>
#include <vector>

#include "pipeline/read/dicom/dicom_series.h"

namespace trocar::pipeline {

/// Joins the parts of scans, as group_series() describes. A joined series takes the place of its
/// first part. A broken file that is alone in its series and has the same study, description and
/// modality becomes a part, too, so that the scan is not taken without it.
void join_parts(std::vector<DicomSeries>& series);

/// If series[index] has a single slice, and at least two other series of its study and size have,
/// too: the attribute in which they differ, or what else keeps them from being joined. Otherwise
/// empty.
std::string why_not_joined(const std::vector<DicomSeries>& series, std::size_t index);

}  // namespace trocar::pipeline
