// SPDX-License-Identifier: GPL-3.0-or-later
// Pieces of work on TBB's threads.
#pragma once

#include <functional>

namespace trocar::pipeline {

/// Calls one_piece(0), ..., one_piece(pieces - 1) once each, several at the same time, started in
/// about this order. What precedes the call happens before each piece, and each piece happens
/// before the call returns.
void for_each_piece(int pieces, const std::function<void(int)>& one_piece);

}  // namespace trocar::pipeline
