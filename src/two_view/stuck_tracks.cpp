// SPDX-License-Identifier: BSD-3-Clause
#include "two_view/stuck_tracks.h"

#include "base/median.h"
#include "image/cell_grid.h"
#include "two_view/essential_motion.h"

#include <algorithm>
#include <cstddef>
#include <vector>

namespace dsorb {
namespace {

constexpr float kStill = 0.5F;          // largest distance from the place in the reference [px]
constexpr double kMinMoved = 3;         // median of the others in the newest frame [px]
constexpr double kMinDistance = 0.5;    // median from the epipolar lines of the others [px]
constexpr double kMinShare = 0.03;      // of the tracks; a few are outliers like others
constexpr int kMinOthers = 50;          // an attempt needs as many
constexpr double kMaxCellShare = 0.45;  // of the image's cells with tracks; more: the scene stands
constexpr int kColumns = 8;
constexpr int kRows = 6;

/// Whether each track stands still in all frames.
std::vector<char> stillTracks(const CornerTracks& tracks) {
  std::vector<char> still(static_cast<std::size_t>(tracks.size()), 1);
  for (const std::vector<Eigen::Vector2f>& positions : tracks.positions) {
    for (std::size_t i = 0; i < still.size(); ++i) {
      const float moved = (positions[i] - tracks.positions.front()[i]).norm();
      if (moved > kStill) still[i] = 0;  // unseen is not moved
    }
  }
  return still;
}

/// Share of the cells with tracks in which most of these stand still.
double stillCells(const Matches& matches,
                  const std::vector<char>& still,
                  const PinholeCamera& camera) {
  const CellGrid grid(camera.width, camera.height, kColumns, kRows);
  std::vector<int> balance(grid.size(), 0);
  std::vector<char> taken(grid.size(), 0);
  for (std::size_t i = 0; i < still.size(); ++i) {
    const std::size_t cell = grid.at(matches.reference[i].x(), matches.reference[i].y());
    balance[cell] += still[i] != 0 ? 1 : -1;
    taken[cell] = 1;
  }
  const auto standing = std::count_if(balance.begin(), balance.end(), [](int b) { return b > 0; });
  return static_cast<double>(standing) /
         static_cast<double>(std::count(taken.begin(), taken.end(), 1));
}

}  // namespace

std::vector<Eigen::Vector2f> leaveOutStuck(CornerTracks& tracks,
                                           const PinholeCamera& camera,
                                           std::uint64_t seed) {
  const std::vector<char> still = stillTracks(tracks);
  const auto count = static_cast<int>(std::count(still.begin(), still.end(), 1));
  if (count < kMinShare * tracks.size() || tracks.size() - count < kMinOthers) return {};
  const Matches all = tracks.matchesTo(tracks.frames() - 1);
  Matches standing;
  Matches others;
  std::vector<double> moved;
  for (std::size_t i = 0; i < still.size(); ++i) {
    Matches& part = still[i] != 0 ? standing : others;
    part.reference.push_back(all.reference[i]);
    part.target.push_back(all.target[i]);
    if (still[i] == 0) moved.push_back((all.target[i] - all.reference[i]).norm());
  }
  if (medianInPlace(moved) < kMinMoved || stillCells(all, still, camera) > kMaxCellShare) return {};
  const auto motion = estimateEssentialMotion(others, camera, seed);
  if (!motion) return {};
  const double distance = medianOf(epipolarDistances(motion->T_cur_ref, standing, camera));
  if (distance < kMinDistance) return {};
  std::vector<Eigen::Vector2f> stuck;
  stuck.reserve(standing.size());
  for (const Eigen::Vector2d& pixel : standing.reference) {
    stuck.emplace_back(pixel.cast<float>());
  }
  tracks.drop(still);
  return stuck;
}

}  // namespace dsorb
