// SPDX-License-Identifier: GPL-3.0-or-later
// Pieces of work on TBB's threads.
#pragma once

#include <functional>

namespace trocar::pipeline {

/// Calls one_piece(0), ..., one_piece(pieces - 1), each once, some at the same time; they begin
/// about in this order. What stands before the call happens before each, and each before its
/// return.
void for_each_piece(int pieces, const std::function<void(int)>& one_piece);

}  // namespace trocar::pipeline
