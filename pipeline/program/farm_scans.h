// SPDX-License-Identifier: GPL-3.0-or-later
// The farm's interface to meshing (farm/scan_program.h). A scan's parameters are the options of
// trocar-mesh, read by the same parser.
// Tests: tests/pipeline/program/parameters_test.cpp
#pragma once

#include <memory>
#include <string>
#include <vector>

#include "pipeline/farm/scan_program.h"

namespace trocar::pipeline {

class FarmScans : public farm::ScanProgram {
 public:
  /// Errors (usage): an option that trocar-mesh does not have, or that is not allowed in a
  /// collection; the errors of the command line, with the same messages.
  Result<farm::Parameters> parameters(const nlohmann::json& given) const override;
  /// True for all inputs except NIfTI files.
  bool opens_first(const std::vector<std::filesystem::path>& inputs,
                   const farm::Parameters& parameters) const override;
  Result<std::unique_ptr<farm::OpenedScan>> open(const nlohmann::json& given,
                                                 const std::vector<std::filesystem::path>& inputs,
                                                 const std::string& series,
                                                 int threads) const override;
};

/// The options that a collection may give as parameters, without the leading --.
std::vector<std::string> collection_options();

}  // namespace trocar::pipeline
