// SPDX-License-Identifier: Apache-2.0
// Encodes events as JSON with a text, and values and meshes as bytes (protocol.md). A binary
// message begins with its kind and its number, which are not encoded here.
// Tests: tests/e2e/console_server_test.py
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "formats/session/telemetry.h"
#include "runtime/console/force_history.h"

namespace trocar::runtime {

/// Returns the JSON object of one event, for the message `events`.
std::string event_message(const TelemetryEvent& event);

/// Returns the contents of a message of kind 1 (snapshot), without kind and number.
std::string snapshot_message(const std::vector<double>& values);

/// Returns the contents of a message of kind 4 (history), without kind and number.
std::string history_message(const std::vector<ForceHistory::Point>& points);

/// Returns the contents of a message of kind 2 (sheet, two floats per vertex) or 3 (shape: the
/// deformed sheet around the tool, three floats per vertex), without kind and number.
std::string mesh_message(std::int32_t sheet, std::uint32_t cuts, std::int32_t slice,
                         const std::vector<float>& positions, std::size_t floats_of_vertex,
                         const std::vector<float>& hu, const std::vector<std::uint32_t>& triangles);

}  // namespace trocar::runtime
