// SPDX-License-Identifier: GPL-3.0-or-later
// The kinds of instances (SOP classes) and the encodings (transfer syntaxes) that are accepted from
// the network. They are the ones that trocar-mesh can read.
// Tests: tests/e2e/archive_receive_test.py
#pragma once

#include <string_view>
#include <vector>

namespace trocar::archive {

/// UIDs of the SOP classes, in the form that DCMTK's functions take: CT, MR, PET, 3D X-ray,
/// and DICOM segmentations.
std::vector<const char*> storage_classes();

bool is_storage_class(std::string_view uid);

/// UIDs of the transfer syntaxes, in order of preference. The uncompressed ones come first.
std::vector<const char*> transfer_syntaxes();

}  // namespace trocar::archive
