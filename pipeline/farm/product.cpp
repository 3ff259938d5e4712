// SPDX-License-Identifier: GPL-3.0-or-later
#include "pipeline/farm/product.h"

namespace trocar::farm {

const char* product_name(ProductKind kind) {
  constexpr std::array kNames = {"preview", "surface", "scene", "check"};
  return kNames.at(static_cast<std::size_t>(kind));
}

std::optional<ProductKind> product_kind(std::string_view name) {
  for (const ProductKind kind : kProductKinds)
    if (name == product_name(kind)) return kind;
  return std::nullopt;
}

const char* product_file(ProductKind kind) {
  constexpr std::array kFiles = {"preview.png", "surface.stl", "scene.json", "check.txt"};
  return kFiles.at(static_cast<std::size_t>(kind));
}

bool is_made_by_run(ProductKind kind) {
  return kind == ProductKind::kScene || kind == ProductKind::kCheck;
}

}  // namespace trocar::farm
