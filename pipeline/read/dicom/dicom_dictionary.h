// SPDX-License-Identifier: GPL-3.0-or-later
// Fills the dictionary of DCMTK, the library that parses DICOM files, with the few elements that
// the program needs. DCMTK's own dictionary file is left out. Files in implicit VR do not state the
// type (value representation, VR) of an element, so DCMTK looks it up in the dictionary.
#pragma once

namespace trocar::pipeline {

/// Prevents DCMTK from reading its dictionary file, because that takes 13 ms. If the environment
/// variable DCMDICTPATH names a dictionary file, DCMTK still reads it. Call this function first in
/// main(), and only in a program that needs no elements other than those of
/// add_known_dicom_elements().
void leave_out_dicom_dictionary();

/// Adds the elements that trocar-mesh uses to DCMTK's dictionary, unless they are there already.
/// set_up_dcmtk() calls this function.
void add_known_dicom_elements();

}  // namespace trocar::pipeline
