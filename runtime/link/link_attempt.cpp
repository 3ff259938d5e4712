// SPDX-License-Identifier: Apache-2.0
#include "runtime/link/link_attempt.h"

#include <algorithm>
#include <cerrno>

#include "formats/base/system_message.h"

namespace trocar::runtime {
namespace {

/// The likely mistake of a drive whose states are refused for this reason.
std::string wrong_states(LinkRefusal refusal, const FaultDetail& refused, bool pose) {
  switch (refusal) {
    case LinkRefusal::kContents:
      return measured(refused) +
             (pose ? "; positions are in m, and the quaternion is a unit" : "; angles are in rad");
    case LinkRefusal::kMac:
      return "they must have a MAC with the key of the session, not with the shared one";
    case LinkRefusal::kSession:
      return "they do not have the number of this session";
    case LinkRefusal::kSequence:
      return "their number does not rise from 1";
    case LinkRefusal::kSize:
      return "their size, or the size that they state, is wrong";
    default:  // magic and kind
      return "they do not begin like a state";
  }
}

}  // namespace

void LinkAttempt::note(std::span<const std::uint8_t> datagram) noexcept {
  constexpr std::size_t kVersionAt = 4;  // the version follows the magic
  DenialPacket denial;
  if (decode(datagram, nonce, denial) == LinkRefusal::kNone) {
    wrong_key = wrong_key || denial.reason == DenialReason::kKey;
    busy = busy || denial.reason == DenialReason::kBusy;
    other_kind = other_kind || denial.reason == DenialReason::kKind;
    return;
  }
  LinkNonce ignored;
  const bool is_link = datagram.size() > kVersionAt &&
                       std::equal(kLinkMagic.begin(), kLinkMagic.end(), datagram.begin());
  other_version = other_version || (is_link && datagram[kVersionAt] != kLinkVersion);
  // A program that echoes datagrams sends back the hello.
  other_program = other_program || !is_link || hello_nonce(datagram, ignored);
}

std::string LinkAttempt::why(int socket_error, LinkContents wanted) const {
  const bool pose = wanted == LinkContents::kPose;
  if (welcomed && state_refusal != LinkRefusal::kNone) {
    return std::string("the device's states are refused (") + to_string(state_refusal) +
           "): " + wrong_states(state_refusal, refused, pose) + "; compare with device_link.md";
  }
  // This also happens if another host's session began between the welcome and the first command.
  if (welcomed) {
    return "the device answered but sends no states; end another host's session with it, or "
           "restart it";
  }
  if (wrong_key) {
    return "the device there has another key; --key-file must be a copy of the file that it was "
           "started with";
  }
  if (other_kind) {
    return std::string("the device there is of another kind: it states ") +
           (pose ? "angles; use --device udp:" : "poses; use --device pose:");
  }
  if (busy) return "the device there is in a session with another host; end that one first";
  if (other_version) return "the device there speaks another version of the device link";
  if (other_program) {
    return "another program answers there, not a device; check the address and the port";
  }
  if (socket_error == ECONNREFUSED) {
    return "no device answers there: nothing listens on this port; start the device, or check "
           "the port";
  }
  if (socket_error != 0) {
    return "no device answers there: " + system_message(socket_error);
  }
  return std::string(
             "no device answers there: the host is off or cannot be reached (address, "
             "cable, firewall), or its device has another key and does not answer") +
         (pose ? " or states angles (--device udp:)" : "");
}

}  // namespace trocar::runtime
