// SPDX-License-Identifier: GPL-3.0-or-later
// The products of a scan besides its asset (farm/product.h), as a review shows them.
#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "pipeline/farm/product.h"
#include "pipeline/farm/store.h"

namespace trocar::pipeline {

struct ShownProduct {
  farm::ProductKind kind = farm::ProductKind::kPreview;
  std::filesystem::path file;  ///< path within the store; empty if the product failed
  std::string reason;          ///< reason of the failure, at most about 400 bytes of it
  bool is_done() const { return !file.empty(); }
};

/// The scan's products in the order of farm::kProductKinds. A product whose file is missing counts
/// as failed. If the product's entry in the store's index cannot be read, the product is left out.
std::vector<ShownProduct> products_of(const farm::Store& store, const std::string& scan);

}  // namespace trocar::pipeline
