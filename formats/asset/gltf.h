// SPDX-License-Identifier: Apache-2.0
// Includes tinygltf, which reads assets. Internal to formats/. Debian's libdraco exports a tinygltf
// built with other options; to keep the two apart, every file that includes this one is compiled
// with hidden visibility.
// Tests: tests/formats/asset/asset_test.cpp
#pragma once

#define TINYGLTF_NO_STB_IMAGE
#define TINYGLTF_NO_STB_IMAGE_WRITE
#define TINYGLTF_NO_INCLUDE_STB_IMAGE
#define TINYGLTF_NO_INCLUDE_STB_IMAGE_WRITE
#define TINYGLTF_NO_EXTERNAL_IMAGE
#include <tiny_gltf.h>
