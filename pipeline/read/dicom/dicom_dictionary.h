// SPDX-License-Identifier: GPL-3.0-or-later
// DCMTK's dictionary states the value representation (type) of each element, because files in
// implicit VR do not state it.
// Tests: tests/pipeline/read/dicom/dicom_dictionary_test.cpp
#pragma once

namespace trocar::pipeline {

/// Prevents DCMTK from reading its dictionary file, 5,000 lines of text that take 13 ms, unless the
/// environment names such a file (DCMDICTPATH). Call the function first in main(), and only in a
/// program that needs no elements other than those of add_known_dicom_elements().
void leave_out_dicom_dictionary();

/// Adds the elements that the program uses to DCMTK's dictionary if they are missing there. DCMTK
/// reads elements that are not in the dictionary with unknown representation.
void add_known_dicom_elements();

}  // namespace trocar::pipeline
