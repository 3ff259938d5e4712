// SPDX-License-Identifier: GPL-3.0-or-later
// The products of a scan, as a review shows them.
// Tests: tests/e2e/review_test.py
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
  std::string reason;          ///< reason of the failure; a long one is cut
  bool is_done() const { return !file.empty(); }
};

/// The scan's products in the order of farm::kProductKinds. A product whose file is missing counts
/// as failed. A product whose entry of the index cannot be read is left out.
std::vector<ShownProduct> products_of(const farm::Store& store, const std::string& scan);

}  // namespace trocar::pipeline
