// SPDX-License-Identifier: GPL-3.0-or-later
// Encryption (TLS) of associations, and the rule that without it only this computer is reached.
// Tests: tests/e2e/archive_test.py
#pragma once

#include <filesystem>
#include <memory>
#include <string>

#include "formats/base/result.h"

class DcmTransportLayer;

namespace trocar::archive {

/// PEM files. Either all three are given, or none.
struct TlsFiles {
  std::filesystem::path key;   ///< private key of this side
  std::filesystem::path cert;  ///< certificate of this side
  std::filesystem::path ca;    ///< certificates of those who sign the other side's certificate

  bool is_given() const { return !key.empty() || !cert.empty() || !ca.empty(); }
};

/// Checks that the three files are given together, or, without them, that `host` means this computer
/// or `insecure` is set. Errors (usage): the message names the option.
Result<void> check_transport(const TlsFiles& files, const std::string& host, bool insecure);

enum class TlsRole { kServer, kClient };

/// TLS 1.2 or later with the ciphers of BCP 195; the certificate of the other side is required and
/// verified. Returns null if no files are given. Errors (refused): names the file.
Result<std::shared_ptr<DcmTransportLayer>> make_transport(const TlsFiles& files, TlsRole role);

}  // namespace trocar::archive
