// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "dsorb/camera/pinhole_camera.h"
#include "dsorb/geometry/se3.h"

#include "synthetic/texture.h"

#include <cstdint>
#include <optional>
#include <vector>

namespace dsorb::synthetic {

/// Textured cuboid; with one half size 0 it is a rectangle of a plane, with `seen_from_inside` a
/// room.
struct Box {
  SE3 T_world_box;
  Eigen::Vector3d half_size{1, 1, 1};  ///< [m] along the box axes
  int texture = 0;                     ///< index into Scene::textures; faces use different parts
  bool seen_from_inside = false;
};

/// Boxes, textures and sky. Rays that hit no box see the sky, which is infinitely far away.
struct Scene {
  std::vector<Texture> textures;
  std::vector<Box> boxes;
  Texture sky;  ///< over a cube of half size 1 around the camera
};

/// Where things are while rows of the image are exposed.
struct Moment {
  SE3 T_world_cam;
  std::optional<SE3> T_world_moving;  ///< of the scene's last box, where it moves by itself
};

struct RenderOptions {
  int supersampling = 1;       ///< n x n rays a pixel everywhere
  int edge_supersampling = 3;  ///< n x n rays for pixels on the border between two surfaces
};

/// Rendered view, row-major.
struct View {
  int width = 0;
  int height = 0;
  std::vector<float> intensity;       ///< [grey levels], 0 to 255
  std::vector<float> inverse_depth;   ///< of the ray through the pixel centre [1/m]; 0: sky
  std::vector<std::int32_t> surface;  ///< 8 * box + face; -1: sky
};

/// Casts rays through a scene. Runs in parallel; the bits do not depend on the number of threads.
/// @param moments of each row from the top (rolling shutter), or a single one for all rows
/// @throws std::invalid_argument on a camera without size or focal length, without any ray, or on
///         another number of moments
[[nodiscard]] View render(const Scene& scene,
                          const PinholeCamera& camera,
                          const std::vector<Moment>& moments,
                          const RenderOptions& options = {});

/// All rows at once, all boxes at rest.
[[nodiscard]] View render(const Scene& scene,
                          const PinholeCamera& camera,
                          const SE3& T_world_cam,
                          const RenderOptions& options = {});

}  // namespace dsorb::synthetic
