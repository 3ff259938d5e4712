// SPDX-License-Identifier: Apache-2.0
// tinygltf, which reads assets. Internal to formats/: every file that
// includes this is compiled with hidden visibility, since Debian's libdraco exports a tinygltf of
// its own, built with other options, that must not be mixed with ours.
#pragma once

#define TINYGLTF_NO_STB_IMAGE
#define TINYGLTF_NO_STB_IMAGE_WRITE
#define TINYGLTF_NO_INCLUDE_STB_IMAGE
#define TINYGLTF_NO_INCLUDE_STB_IMAGE_WRITE
#define TINYGLTF_NO_EXTERNAL_IMAGE
#include <tiny_gltf.h>
