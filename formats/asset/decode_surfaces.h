// SPDX-License-Identifier: Apache-2.0
// The surfaces for display of a file that tinygltf has read. Internal to formats/; includes
// tinygltf (see gltf.h).
// Tests: tests/formats/asset/asset_surface_test.cpp
#pragma once
#include "formats/asset/asset.h"
#include "formats/asset/gltf_document.h"

namespace trocar {

/// Appends the document's surfaces to the asset, whose materials are known.
Result<void> decode_surfaces(const GltfDocument& document, Asset& asset);

}  // namespace trocar
