// SPDX-License-Identifier: BSD-3-Clause
#include "synthetic/scene.h"

#include "base/parallel.h"

#include <Eigen/Geometry>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <limits>
#include <numeric>
#include <stdexcept>
#include <string>

namespace dsorb::synthetic {
namespace {

constexpr int kTileWidth = 32;   // pixels that share one list of boxes and are shaded together
constexpr int kTileHeight = 16;  // [px]
constexpr std::int32_t kSky = -1;
constexpr double kNearest = 1e-3;  // nothing nearer is seen [m]

// Texture axes (u, v) of the faces across each box axis: v is the vertical of upright boxes.
constexpr std::array<std::array<int, 2>, 3> kFaceAxes = {{{2, 1}, {0, 2}, {0, 1}}};

/// A box in the coordinates in which its rays are cast: camera centre and the ray through pixel
/// (x, y) as origin_ray + x * step_x + y * step_y, all in box axes, scaled to camera z = 1.
struct PreparedBox {
  Eigen::Vector3d centre;
  Eigen::Vector3d origin_ray;
  Eigen::Vector3d step_x;
  Eigen::Vector3d step_y;
  Eigen::Vector3d half_size;
  const Texture* texture;
  bool inside;
  Eigen::AlignedBox2d seen;  ///< part of the image plane that it may cover [px]
  double nearest;            ///< no point of it has a smaller depth, nor one below kNearest [m]
};

struct Hit {
  double depth = std::numeric_limits<double>::infinity();
  int box = -1;
  int axis = 0;
  bool positive = false;  ///< the face at + half_size
};

/// Replaces `nearest` (but for its box) where the ray meets this box before it.
bool intersect(const PreparedBox& box, const Eigen::Vector3d& ray, Hit& nearest) {
  double enter = -std::numeric_limits<double>::infinity();
  double leave = std::numeric_limits<double>::infinity();
  int enter_axis = 0;
  int leave_axis = 0;
  for (int axis = 0; axis < 3; ++axis) {
    const double inverse = 1.0 / ray[axis];
    const double low = (-box.half_size[axis] - box.centre[axis]) * inverse;
    const double high = (box.half_size[axis] - box.centre[axis]) * inverse;
    const double first = std::min(low, high);
    const double second = std::max(low, high);
    if (first > enter) {
      enter = first;
      enter_axis = axis;
    }
    if (second < leave) {
      leave = second;
      leave_axis = axis;
    }
  }
  const double depth = box.inside ? leave : enter;
  if (!(enter <= leave) || depth < kNearest || depth >= nearest.depth) return false;
  nearest.depth = depth;
  nearest.axis = box.inside ? leave_axis : enter_axis;
  nearest.positive = (ray[nearest.axis] > 0) == box.inside;
  return true;
}

/// Part of a texture that one ray sees.
struct TexturePatch {
  const Texture* texture;
  Footprint footprint;
};

/// Grey levels of many patches, texture by texture.
class PatchSampler {
 public:
  void clear() { patches_.clear(); }
  void add(const TexturePatch& patch) { patches_.push_back(patch); }

  /// One a patch, in the order in which they were added.
  const std::vector<float>& sample() {
    greys_.resize(patches_.size());
    for (std::size_t first = 0; first < patches_.size(); ++first) {
      const Texture* texture = patches_[first].texture;
      if (texture == nullptr) continue;
      members_.clear();
      footprints_.clear();
      for (std::size_t i = first; i < patches_.size(); ++i) {
        if (patches_[i].texture != texture) continue;
        members_.push_back(i);
        footprints_.push_back(patches_[i].footprint);
        patches_[i].texture = nullptr;
      }
      sampleTexture(*texture, footprints_, sampled_);
      for (std::size_t i = 0; i < members_.size(); ++i) greys_[members_[i]] = sampled_[i];
    }
    return greys_;
  }

 private:
  std::vector<TexturePatch> patches_;  // without texture once sampled
  std::vector<float> greys_;
  std::vector<std::size_t> members_;
  std::vector<Footprint> footprints_;
  std::vector<float> sampled_;
};

class Renderer {
 public:
  Renderer(const Scene& scene, const PinholeCamera& camera, const Moment& moment)
      : camera_(camera) {
    const SE3& T_world_cam = moment.T_world_cam;
    const auto prepare_in_scene = [&](const Box& box) {
      const Texture& texture = scene.textures.at(static_cast<std::size_t>(box.texture));
      return prepare(box, texture, T_world_cam);
    };
    boxes_.reserve(scene.boxes.size());
    for (const Box& box : scene.boxes) boxes_.push_back(prepare_in_scene(box));
    if (moment.T_world_moving) {
      Box moved = scene.boxes.back();
      moved.T_world_box = *moment.T_world_moving;
      boxes_.back() = prepare_in_scene(moved);
    }
    nearest_first_.resize(boxes_.size());
    std::iota(nearest_first_.begin(), nearest_first_.end(), 0);
    std::stable_sort(nearest_first_.begin(), nearest_first_.end(), [&](int left, int right) {
      return boxes_[static_cast<std::size_t>(left)].nearest <
             boxes_[static_cast<std::size_t>(right)].nearest;
    });
    Box sky;
    sky.T_world_box.setTranslation(T_world_cam.translation());
    sky.seen_from_inside = true;
    sky_ = prepare(sky, scene.sky, T_world_cam);
  }

  /// Boxes that may be seen in the pixels from (x0, y0) to before (x1, y1), nearest first.
  void findCandidates(int x0, int y0, int x1, int y1, std::vector<int>& candidates) const {
    candidates.clear();
    for (const int i : nearest_first_) {
      const Eigen::AlignedBox2d& seen = boxes_[static_cast<std::size_t>(i)].seen;
      if (seen.min().x() <= x1 && seen.max().x() >= x0 - 1 && seen.min().y() <= y1 &&
          seen.max().y() >= y0 - 1) {
        candidates.push_back(i);
      }
    }
  }

  /// Nearest surface along the ray through a pixel position.
  [[nodiscard]] Hit cast(double x, double y, const std::vector<int>& candidates) const {
    Hit hit;
    for (const int i : candidates) {
      const PreparedBox& box = boxes_[static_cast<std::size_t>(i)];
      if (box.nearest > hit.depth) break;
      if (intersect(box, box.origin_ray + x * box.step_x + y * box.step_y, hit)) hit.box = i;
    }
    return hit;
  }

  /// What is seen where the ray through a pixel position ended.
  [[nodiscard]] TexturePatch patchAt(double x, double y, Hit hit) const {
    const PreparedBox& box = hit.box < 0 ? sky_ : boxes_[static_cast<std::size_t>(hit.box)];
    const Eigen::Vector3d ray = box.origin_ray + x * box.step_x + y * box.step_y;
    if (hit.box < 0) intersect(sky_, ray, hit);
    const double slope_x = box.step_x[hit.axis] / ray[hit.axis];
    const double slope_y = box.step_y[hit.axis] / ray[hit.axis];
    const auto along = [&](int axis) {
      const double per_x = hit.depth * (box.step_x[axis] - slope_x * ray[axis]);
      const double per_y = hit.depth * (box.step_y[axis] - slope_y * ray[axis]);
      return static_cast<float>(std::sqrt(per_x * per_x + per_y * per_y));
    };
    const int face = 2 * hit.axis + static_cast<int>(hit.positive);
    const int axis_u = kFaceAxes[static_cast<std::size_t>(hit.axis)][0];
    const int axis_v = kFaceAxes[static_cast<std::size_t>(hit.axis)][1];
    // Every face shows another part of the texture.
    const double elsewhere = 37.0 * face;
    return {box.texture,
            {static_cast<float>(box.centre[axis_u] + hit.depth * ray[axis_u] + elsewhere),
             static_cast<float>(box.centre[axis_v] + hit.depth * ray[axis_v] + elsewhere),
             along(axis_u),
             along(axis_v)}};
  }

 private:
  [[nodiscard]] PreparedBox prepare(const Box& box,
                                    const Texture& texture,
                                    const SE3& T_world_cam) const {
    const SE3 T_box_cam = box.T_world_box.inverse() * T_world_cam;
    const Eigen::Matrix3d R_box_cam = T_box_cam.rotationMatrix();
    PreparedBox prepared;
    prepared.centre = T_box_cam.translation();
    prepared.origin_ray = R_box_cam * camera_.unproject({0, 0});
    prepared.step_x = R_box_cam.col(0) / camera_.fx;
    prepared.step_y = R_box_cam.col(1) / camera_.fy;
    prepared.half_size = box.half_size;
    prepared.texture = &texture;
    prepared.inside = box.seen_from_inside;
    bound(T_box_cam.inverse(), prepared);
    return prepared;
  }

  /// Sets `seen` and `nearest` from the edges of the box, cut off at depth kNearest.
  void bound(const SE3& T_cam_box, PreparedBox& box) const {
    std::array<Eigen::Vector3d, 8> corners;
    for (std::size_t i = 0; i < corners.size(); ++i) {
      const Eigen::Vector3d signs(
          (i & 1U) != 0 ? 1 : -1, (i & 2U) != 0 ? 1 : -1, (i & 4U) != 0 ? 1 : -1);
      corners[i] = T_cam_box * box.half_size.cwiseProduct(signs);
    }
    box.nearest = std::numeric_limits<double>::infinity();
    for (std::size_t i = 0; i < corners.size(); ++i) {
      box.nearest = std::min(box.nearest, std::max(corners[i].z(), kNearest));
      if (corners[i].z() >= kNearest) box.seen.extend(camera_.project(corners[i]));
      for (std::size_t bit = 1; bit < corners.size(); bit *= 2) {
        const Eigen::Vector3d& other = corners[i ^ bit];
        if ((corners[i].z() < kNearest) == (other.z() < kNearest)) continue;
        const double share = (kNearest - corners[i].z()) / (other.z() - corners[i].z());
        Eigen::Vector3d cut = corners[i] + share * (other - corners[i]);
        cut.z() = kNearest;
        box.seen.extend(camera_.project(cut));
      }
    }
  }

  const PinholeCamera& camera_;
  std::vector<PreparedBox> boxes_;
  std::vector<int> nearest_first_;
  PreparedBox sky_;
};

/// Part of the image whose rays are cast and shaded together.
struct Tile {
  const Renderer& renderer;
  int x0, y0, x1, y1;                  ///< its pixels, from (x0, y0) to before (x1, y1)
  const std::vector<int>& candidates;  ///< boxes that may be seen there
};

/// Calls function(tile, sampler) for the tiles of the image.
/// @param renderers one for all rows, or one for each
template <typename Function>
void forEachTile(const std::vector<Renderer>& renderers,
                 const View& view,
                 const Function& function) {
  const int tile_height = renderers.size() == 1 ? kTileHeight : 1;
  const int columns = (view.width + kTileWidth - 1) / kTileWidth;
  const int rows = (view.height + tile_height - 1) / tile_height;
  forEachRange(static_cast<std::size_t>(rows), 1, [&](std::size_t begin, std::size_t end) {
    std::vector<int> candidates;
    PatchSampler sampler;
    for (std::size_t row = begin; row < end; ++row) {
      const Renderer& renderer = renderers[renderers.size() == 1 ? 0 : row];
      const int y0 = static_cast<int>(row) * tile_height;
      const int y1 = std::min(view.height, y0 + tile_height);
      for (int column = 0; column < columns; ++column) {
        const int x0 = column * kTileWidth;
        const int x1 = std::min(view.width, x0 + kTileWidth);
        renderer.findCandidates(x0, y0, x1, y1, candidates);
        sampler.clear();
        function(Tile{renderer, x0, y0, x1, y1, candidates}, sampler);
      }
    }
  });
}

std::size_t pixelIndex(const View& view, int x, int y) {
  return static_cast<std::size_t>(y) * static_cast<std::size_t>(view.width) +
         static_cast<std::size_t>(x);
}

void renderCentres(const std::vector<Renderer>& renderers, bool shade, View& view) {
  forEachTile(renderers, view, [&](const Tile& tile, PatchSampler& sampler) {
    for (int y = tile.y0; y < tile.y1; ++y) {
      for (int x = tile.x0; x < tile.x1; ++x) {
        const auto pixel = pixelIndex(view, x, y);
        const Hit hit = tile.renderer.cast(x, y, tile.candidates);
        view.inverse_depth[pixel] = static_cast<float>(1.0 / hit.depth);
        view.surface[pixel] =
            hit.box < 0 ? kSky : 8 * hit.box + 2 * hit.axis + static_cast<int>(hit.positive);
        if (shade) sampler.add(tile.renderer.patchAt(x, y, hit));
      }
    }
    if (!shade) return;
    const float* grey = sampler.sample().data();
    const int width = tile.x1 - tile.x0;
    for (int y = tile.y0; y < tile.y1; ++y, grey += width) {
      std::copy_n(grey, width, &view.intensity[pixelIndex(view, tile.x0, y)]);
    }
  });
}

bool isOnEdge(const View& view, int x, int y) {
  const auto surface = [&](int column, int row) {
    return view.surface[pixelIndex(
        view, std::clamp(column, 0, view.width - 1), std::clamp(row, 0, view.height - 1))];
  };
  const std::int32_t own = surface(x, y);
  return surface(x - 1, y) != own || surface(x + 1, y) != own || surface(x, y - 1) != own ||
         surface(x, y + 1) != own;
}

/// Casts n x n rays of a pixel.
void castRays(const Tile& tile, int x, int y, int n, PatchSampler& sampler) {
  for (int j = 0; j < n; ++j) {
    for (int i = 0; i < n; ++i) {
      const double ray_x = x + (i + 0.5) / n - 0.5;
      const double ray_y = y + (j + 0.5) / n - 0.5;
      const Hit hit = tile.renderer.cast(ray_x, ray_y, tile.candidates);
      sampler.add(tile.renderer.patchAt(ray_x, ray_y, hit));
    }
  }
}

/// Averages n x n rays of every pixel, or of those on the border between two surfaces.
void renderAveraged(const std::vector<Renderer>& renderers, int n, bool edges_only, View& view) {
  const auto rays = static_cast<std::ptrdiff_t>(n) * n;
  forEachTile(renderers, view, [&](const Tile& tile, PatchSampler& sampler) {
    std::vector<std::size_t> pixels;
    for (int y = tile.y0; y < tile.y1; ++y) {
      for (int x = tile.x0; x < tile.x1; ++x) {
        if (edges_only && !isOnEdge(view, x, y)) continue;
        pixels.push_back(pixelIndex(view, x, y));
        castRays(tile, x, y, n, sampler);
      }
    }
    const float* grey = sampler.sample().data();
    for (const std::size_t pixel : pixels) {
      view.intensity[pixel] = std::accumulate(grey, grey + rays, 0.0F) / static_cast<float>(rays);
      grey += rays;
    }
  });
}

}  // namespace

View render(const Scene& scene,
            const PinholeCamera& camera,
            const std::vector<Moment>& moments,
            const RenderOptions& options) {
  if (camera.width <= 0 || camera.height <= 0 || !(camera.fx > 0) || !(camera.fy > 0)) {
    throw std::invalid_argument("render: camera of " + std::to_string(camera.width) + " x " +
                                std::to_string(camera.height) + " px with focal lengths " +
                                std::to_string(camera.fx) + ", " + std::to_string(camera.fy));
  }
  if (options.supersampling < 1 || options.edge_supersampling < 1) {
    throw std::invalid_argument("render: supersampling must be at least 1, is " +
                                std::to_string(options.supersampling) + " and " +
                                std::to_string(options.edge_supersampling) + " at edges");
  }
  if (moments.size() != 1 && moments.size() != static_cast<std::size_t>(camera.height)) {
    throw std::invalid_argument("render: needs 1 moment or one for each of " +
                                std::to_string(camera.height) + " rows, has " +
                                std::to_string(moments.size()));
  }
  const auto pixels =
      static_cast<std::size_t>(camera.width) * static_cast<std::size_t>(camera.height);
  View view{camera.width,
            camera.height,
            std::vector<float>(pixels),
            std::vector<float>(pixels),
            std::vector<std::int32_t>(pixels)};
  std::vector<Renderer> renderers;
  renderers.reserve(moments.size());
  for (const Moment& moment : moments) renderers.emplace_back(scene, camera, moment);
  renderCentres(renderers, options.supersampling == 1, view);
  if (options.supersampling > 1) {
    renderAveraged(renderers, options.supersampling, false, view);
  } else if (options.edge_supersampling > 1) {
    renderAveraged(renderers, options.edge_supersampling, true, view);
  }
  return view;
}

View render(const Scene& scene,
            const PinholeCamera& camera,
            const SE3& T_world_cam,
            const RenderOptions& options) {
  return render(scene, camera, std::vector<Moment>{{T_world_cam, {}}}, options);
}

}  // namespace dsorb::synthetic
