// SPDX-License-Identifier: Apache-2.0
// Encodes the messages to clients (protocol.md): events as JSON with a text for the operator, ticks
// and meshes as bytes. A binary message begins with its kind and its number. The functions
// below encode only the contents that follow; TelemetryClient sends kind and number before them.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "formats/session/telemetry.h"
#include "runtime/console/force_history.h"

namespace trocar::runtime {

/// Returns one event as a JSON object, for the list in the message `events`.
std::string event_message(const TelemetryEvent& event);

/// Returns the contents of a message of kind 1 (snapshot: the values of one tick).
std::string snapshot_message(const std::vector<double>& values);

/// Returns the contents of a message of kind 4 (history of the force).
std::string history_message(const std::vector<ForceHistory::Point>& points);

/// Returns the contents of a message of kind 2 (a sheet with its holes, two floats per vertex) or
/// of kind 3 (shape: the deformed sheet around the tool, three floats per vertex). `sheet`: index
/// of the sheet. `cuts`: number of its holes. `slice`: its slice index. `hu`: one value for each
/// vertex; empty: none.
std::string mesh_message(std::int32_t sheet, std::uint32_t cuts, std::int32_t slice,
                         const std::vector<float>& positions, std::size_t floats_of_vertex,
                         const std::vector<float>& hu, const std::vector<std::uint32_t>& triangles);

}  // namespace trocar::runtime
