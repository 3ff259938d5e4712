// SPDX-License-Identifier: GPL-3.0-or-later
// Divides the slices of a series into volumes. Most series have one. Several phases of a heart, or
// several acquisitions, have slices at the same positions.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "formats/base/result.h"
#include "pipeline/read/dicom/dicom_headers.h"
#include "pipeline/read/slice_stack.h"

namespace trocar::pipeline {

/// Slices at different positions, ascending along the normal of the first one.
struct DicomVolume {
  std::vector<DicomFrame> slices;
  /// What tells the volume from the others of the series, such as "AcquisitionNumber 2"; empty if
  /// there are no others.
  std::string name;
};

/// Divides the slices of a series into volumes. `slices` is not empty.
///
/// - If two slices have the same position and equal pixels, one of them is removed (warning
///   copied_slice).
/// - If slices at the same position differ, the attribute of dicom_volume_keys() that tells them all
///   apart with fewest volumes gives the volumes, in the order of its values. If there is none, an
///   attribute of the time of a slice does, by its order at each position.
/// - If they differ in an attribute of time, the slices may also lie between each other's.
/// - If few slices, less than a quarter, have another orientation than the others, and the others
///   have no gap where they lie, they are left out (warning other_orientation).
///
/// Errors: kRefused if a slice differs from most others in size, orientation, pixel spacing or frame
/// of reference, or if no attribute tells two slices at the same position apart. The message names
/// both files, the odd one first.
Result<std::vector<DicomVolume>> volumes_of(std::vector<DicomFrame> slices,
                                            std::vector<Warning>& warnings);

/// The index of the wanted volume, from 0. `name` is that of the series or input in messages. Errors:
/// kUsage if there are several volumes and none is wanted; the message names them; kUsage if the
/// wanted one does not exist, or if there is only one and one is wanted.
Result<std::size_t> chosen_volume(const std::vector<DicomVolume>& volumes,
                                  std::optional<int> wanted, const std::string& name);

/// Errors: kUsage if a volume is given. `where` names an input that is a single volume.
Result<void> check_no_volume(const std::string& where, std::optional<int> volume);

/// Warnings about one volume: missing_slice, uneven_spacing, gantry_tilt, tilt_contradiction,
/// dense_padding.
void warn_of_volume(const std::vector<DicomFrame>& slices, std::vector<Warning>& warnings);

/// The distances, shift and tilt of the slices of a volume.
StackShape stack_shape(const std::vector<DicomFrame>& slices);

}  // namespace trocar::pipeline
