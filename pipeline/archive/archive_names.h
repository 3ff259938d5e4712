// SPDX-License-Identifier: GPL-3.0-or-later
// Names that come from the network: unique identifiers (UIDs), and the titles of applications (AE
// titles). A UID becomes part of a path only after is_uid() has accepted it.
#pragma once

#include <optional>
#include <string>
#include <string_view>

#include "formats/base/result.h"

namespace trocar::archive {

/// Is the text a UID of DICOM: 1 to 64 characters, numbers separated by single dots? Leading zeros
/// are accepted, because some scanners write them. Each text that is accepted can be used as the
/// name of a file.
bool is_uid(std::string_view text);

/// Is the text an AE title: 1 to 16 printable ASCII characters, without a backslash and without
/// spaces at its ends?
bool is_ae_title(std::string_view text);

/// Makes a text from the network safe for a message. Returns its first 64 characters, with '?' in
/// place of each character that is not printable ASCII.
std::string printable(std::string_view text);

/// An application on the network, "AE@HOST:PORT". AE is its title. HOST is a name, an IPv4 address,
/// or an IPv6 address in brackets; `host` has no brackets.
struct Peer {
  std::string ae, host;
  int port = 0;
};

/// Parses "AE@HOST:PORT". Errors: kUsage if the text does not have this form.
Result<Peer> parse_peer(const std::string& text);

}  // namespace trocar::archive
