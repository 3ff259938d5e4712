// SPDX-License-Identifier: Apache-2.0
// What pages get of a session, as protocol.md has it: events in words, values and meshes as bytes.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "formats/session/live_memory.h"

namespace trocar::runtime {

/// One event of the message `events`, as JSON.
std::string event_message(const LiveEvent& event);

/// A message of kind SNAPSHOT, after its kind and number.
std::string snapshot_message(const std::vector<double>& values);

/// A message of kind SHEET (two floats a vertex) or SHAPE (three), after its kind and number.
std::string mesh_message(std::int32_t sheet, std::uint32_t cuts, std::int32_t slice,
                         const std::vector<float>& places, std::size_t floats_of_vertex,
                         const std::vector<float>& hu, const std::vector<std::uint32_t>& triangles);

}  // namespace trocar::runtime
