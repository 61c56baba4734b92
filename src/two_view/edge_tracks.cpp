// SPDX-License-Identifier: BSD-3-Clause
#include "two_view/edge_tracks.h"

#include "image/contrast.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <vector>

namespace dsorb {
namespace {

constexpr int kEdgeRadius = 7;       // of the square whose gradients are looked at [px]
constexpr float kMaxEdgeRatio = 30;  // of the eigenvalues of a corner's gradient tensor
// Share of the tracks; with fewer corners the others go. Bars have 3 to 19 %, TartanAir's bare
// corridors 52.
constexpr double kMinCornerShare = 0.3;

/// Whether the gradients around a place have one direction only: a misfit of a fraction of a pixel
/// across the edge then moves a track by several times as much along it.
/// @param noise variance that noise gives a gradient [grey levels^2 / px^2]
bool isOnEdge(const PyramidLevel& image, const Eigen::Vector2f& place, float noise) {
  const int x0 = static_cast<int>(std::lround(place.x()));
  const int y0 = static_cast<int>(std::lround(place.y()));
  float xx = 0;
  float xy = 0;
  float yy = 0;
  float pixels = 0;
  for (int y = std::max(0, y0 - kEdgeRadius); y <= std::min(image.height() - 1, y0 + kEdgeRadius);
       ++y) {
    for (int x = std::max(0, x0 - kEdgeRadius); x <= std::min(image.width() - 1, x0 + kEdgeRadius);
         ++x) {
      const ImageSample sample = image.at(x, y);
      ++pixels;
      xx += sample.dx * sample.dx;
      xy += sample.dx * sample.dy;
      yy += sample.dy * sample.dy;
    }
  }
  const float middle = (xx + yy) / 2;
  const float half = std::sqrt((xx - yy) * (xx - yy) / 4 + xy * xy);
  const float of_noise = pixels * noise;
  return middle + half - of_noise > kMaxEdgeRatio * std::max(0.0F, middle - half - of_noise);
}

}  // namespace

void leaveOutEdges(const PyramidLevel& image, CornerTracks& tracks) {
  const auto& shown = tracks.seen.empty() ? tracks.positions.front() : tracks.seen;
  std::vector<char> on_edge;
  on_edge.reserve(shown.size());
  const double noise = noiseOf(image);
  const auto of_gradient = static_cast<float>(noise * noise / 2);  // of a central difference
  for (const Eigen::Vector2f& place : shown) {
    on_edge.push_back(isOnEdge(image, place, of_gradient) ? 1 : 0);
  }
  const auto corners = static_cast<double>(std::count(on_edge.begin(), on_edge.end(), char{0}));
  if (corners < kMinCornerShare * static_cast<double>(shown.size())) tracks.drop(on_edge);
}

}  // namespace dsorb
