// SPDX-License-Identifier: GPL-3.0-or-later
// DCMTK's dictionary states the value representation of each element, because files in implicit VR
// leave it out.
// Tests: tests/pipeline/read/dicom/dicom_dictionary_test.cpp
#pragma once

namespace trocar::pipeline {

/// Prevents DCMTK from reading its dictionary file, 5,000 lines of text that take 13 ms, unless the
/// environment names one (DCMDICTPATH). Call it first in main(), and only in a program that reads
/// DICOM by dicom_parse.h alone and does not write it.
void leave_out_dicom_dictionary();

/// Adds the elements that these readers use to the dictionary if it lacks them. Elements that are
/// not in the dictionary are read with unknown representation.
void add_known_dicom_elements();

}  // namespace trocar::pipeline
