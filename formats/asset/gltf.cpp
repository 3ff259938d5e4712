// SPDX-License-Identifier: Apache-2.0
#define TINYGLTF_IMPLEMENTATION
#include "formats/asset/gltf.h"
