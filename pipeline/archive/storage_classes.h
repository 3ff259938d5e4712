// SPDX-License-Identifier: GPL-3.0-or-later
// The kinds of instances (SOP classes) and the encodings (transfer syntaxes) that are accepted from
// the network. They are the ones that trocar-mesh can read.
#pragma once

#include <string_view>
#include <vector>

namespace trocar::archive {

/// UIDs of the SOP classes of CT, MR, PET and 3D X-ray images, and of DICOM segmentations. They
/// are C strings, because DCMTK's functions take these.
std::vector<const char*> storage_classes();

bool is_storage_class(std::string_view uid);

/// UIDs of the transfer syntaxes, in order of preference. The uncompressed ones come first.
std::vector<const char*> transfer_syntaxes();

}  // namespace trocar::archive
