// SPDX-License-Identifier: BSD-3-Clause
#include "place/appearance.h"

#include "image/cell_grid.h"
#include "place/recognition.h"

#include <Eigen/Core>
#include <opencv2/imgproc.hpp>

#include <cstddef>

namespace dsorb::place {
namespace {

constexpr int kPatchStep = 2;                                 // between the pixels of a patch
constexpr int kPatchReach = 3;                                // steps from its middle to its border
constexpr int kPatchSide = 2 * kPatchReach + 1;               // pixels of a patch in a row
constexpr std::size_t kMiddle = kPatchSide * kPatchSide / 2;  // pixel of a patch
constexpr double kBorder = 2;                                 // of images, for interpolation [px]
constexpr float kMinDeviation = 5;     // of a patch that can be compared [grey levels]
constexpr float kAlikePatches = 0.6F;  // correlation of two patches of one place at least
constexpr int kMinPatches = 8;         // of a cell that can be compared
constexpr double kMinAlike = 0.25;     // share of a cell's patches, that it shows the place
constexpr int kMinCorners = 2;         // of a cell that shows the place
/// Share of the patches in those cells that are alike, that patches tell: rooms with the same walls
/// have .47 to .95, views of the same place .14 to .25 where they tell nothing, .44 to .9 else.
constexpr double kTelling = 0.4;
constexpr double kByChance = 0.1;         // the same by a wrong pose, which had .03
constexpr int kMinCompared = 8;           // that can be compared
constexpr std::size_t kMaxPoints = 2000;  // of a keyframe

using Patch = Eigen::Matrix<float, 1, kPatchSide * kPatchSide>;
using Patches = Eigen::Matrix<float, Eigen::Dynamic, kPatchSide * kPatchSide, Eigen::RowMajor>;

/// Where two images show the patches of points; one row a point.
struct Places {
  std::vector<cv::Vec2f> host;  // at half the size [px]
  std::vector<cv::Vec2f> seen;
  std::vector<std::size_t> cells;  // by point
};

cv::Vec2f halved(const Eigen::Vector2d& pixel) {
  const Eigen::Vector2f half = (0.5 * (pixel.array() + 0.5) - 0.5).cast<float>();
  return {half.x(), half.y()};
}

/// Adds a point's patch where both images show all of it. Its pixels are as far away as it is.
void addPatch(const MapPoint& point,
              const PinholeCamera& host,
              const SE3& T_cam_host,
              const PinholeCamera& camera,
              Places& places) {
  const Eigen::Vector2d middle = point.pixel.cast<double>();
  const double depth = 1 / static_cast<double>(point.inverse_depth);
  const std::size_t before = places.host.size();
  for (int i = 0; i < kPatchSide * kPatchSide; ++i) {
    const Eigen::Vector2d offset(i % kPatchSide - kPatchReach, i / kPatchSide - kPatchReach);
    const Eigen::Vector2d pixel = middle + kPatchStep * offset;
    const Eigen::Vector3d p = T_cam_host * (depth * host.unproject(pixel));
    const Eigen::Vector2d seen = camera.project(p);
    if (!(p.z() > 0) || !camera.contains(seen, kBorder) || !host.contains(pixel, kBorder)) {
      places.host.resize(before);
      places.seen.resize(before);
      return;
    }
    places.host.push_back(halved(pixel));
    places.seen.push_back(halved(seen));
  }
  const CellGrid cells = viewCells(camera);
  const Eigen::Vector2d seen = camera.project(T_cam_host * (depth * host.unproject(middle)));
  places.cells.push_back(cells.at(seen.x(), seen.y()));
}

Patches patchesAt(const cv::Mat& image, const std::vector<cv::Vec2f>& pixels) {
  const Eigen::Index rows = static_cast<Eigen::Index>(pixels.size()) / Patch::SizeAtCompileTime;
  cv::Mat grey;
  cv::remap(image,
            grey,
            cv::Mat(pixels).reshape(2, static_cast<int>(rows)),
            cv::noArray(),
            cv::INTER_LINEAR);
  Patches patches(rows, Patch::SizeAtCompileTime);
  grey.convertTo(cv::Mat(grey.size(), CV_32F, patches.data()), CV_32F);
  return patches;
}

std::vector<int> cornersByCell(const std::vector<Eigen::Vector2f>& corners,
                               const PinholeCamera& camera) {
  const CellGrid cells = viewCells(camera);
  std::vector<int> counts(cells.size(), 0);
  for (const Eigen::Vector2f& corner : corners) ++counts[cells.at(corner.x(), corner.y())];
  return counts;
}

/// Share of the patches that look alike where corners say that they show the same.
double alikeAtCorners(const std::vector<int>& compared,
                      const std::vector<int>& alike,
                      const std::vector<int>& corners) {
  int all = 0;
  int same = 0;
  for (std::size_t i = 0; i < corners.size(); ++i) {
    if (corners[i] < kMinCorners) continue;
    all += compared[i];
    same += alike[i];
  }
  return all > 0 ? static_cast<double>(same) / all : 0;
}

}  // namespace

double contradictedShare(const std::vector<ImagedKeyframe>& keyframes,
                         const GreyImage& image,
                         const PinholeCamera& camera,
                         const SE3& T_world_cam,
                         const std::vector<Eigen::Vector2f>& corners) {
  std::vector<int> compared(viewCells(camera).size(), 0);
  std::vector<int> alike(compared);
  for (const auto& [keyframe, host_image] : keyframes) {
    const SE3 T_cam_host = T_world_cam.inverse() * keyframe->T_world_cam;
    Places places;
    const std::size_t step = 1 + keyframe->points.size() / kMaxPoints;
    for (std::size_t i = 0; i < keyframe->points.size(); i += step) {
      const MapPoint& point = keyframe->points[i];
      if (!(point.inverse_depth > 0)) continue;
      addPatch(point, keyframe->camera, T_cam_host, camera, places);
    }
    if (places.cells.empty()) continue;
    const Patches host = patchesAt(host_image, places.host);
    const Patches seen = patchesAt(image.grey, places.seen);
    for (std::size_t i = 0; i < places.cells.size(); ++i) {
      const auto row = static_cast<Eigen::Index>(i);
      const Patch a = host.row(row).array() - host.row(row).mean();
      const Patch b = seen.row(row).array() - seen.row(row).mean();
      const cv::Vec2f& middle = places.seen[i * Patch::SizeAtCompileTime + kMiddle];
      if (a.norm() < kMinDeviation * kPatchSide || !image.usable({middle[0], middle[1]})) continue;
      ++compared[places.cells[i]];
      if (a.dot(b) > kAlikePatches * a.norm() * b.norm()) ++alike[places.cells[i]];
    }
  }
  const double at_corners = alikeAtCorners(compared, alike, cornersByCell(corners, camera));
  if (at_corners < kByChance) return 1;
  if (at_corners < kTelling) return 0;
  int cells = 0;
  int otherwise = 0;
  for (std::size_t i = 0; i < compared.size(); ++i) {
    if (compared[i] < kMinPatches) continue;
    ++cells;
    if (alike[i] < kMinAlike * compared[i]) ++otherwise;
  }
  return cells < kMinCompared ? 1 : static_cast<double>(otherwise) / cells;
}

}  // namespace dsorb::place
