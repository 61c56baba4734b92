// SPDX-License-Identifier: BSD-3-Clause
#include "synthetic/place_builder.h"
#include "synthetic/places.h"

#include <algorithm>
#include <cmath>
#include <utility>

namespace dsorb::synthetic {
namespace {

constexpr double kBend = 2.2;          // half of the sideways swing of the street [m]
constexpr double kBendPeriod = 170.0;  // length of one swing [m]
constexpr double kBehind = 12.0;       // houses begin this far behind the start [m]
constexpr double kAhead = 110.0;       // and end this far ahead of the last pose [m]
constexpr double kKerb = 4.6;          // from the middle of the street to the pavement [m]
constexpr double kFacade = 7.2;        // from the middle of the street to the houses [m]
constexpr double kHouseDepth = 9.0;    // [m]

class StreetBuilder {
 public:
  using Axis = StreetAxis (*)(double along);
  StreetBuilder(std::uint64_t seed, double begin, double end, Axis axis)
      : builder_(seed), begin_(begin), end_(end), axis_(axis) {}

  Scene build() {
    addGround();
    for (const double side : {-1.0, 1.0}) {
      addHouses(side);
      addCars(side);
      addPosts(side);
      addTrees(side);
    }
    if (axis_ == streetAxis) addEnd();
    builder_.scene().sky = sky();
    return builder_.take();
  }

 private:
  /// Upright box at a lateral position [m] of the street at z, turned with the street.
  void place(double lateral, double z, const Eigen::Vector3d& size, int texture, double above = 0) {
    const StreetAxis axis = axis_(z);
    builder_.add({{axis.x + lateral * std::cos(axis.heading),
                   -above,
                   axis.z - lateral * std::sin(axis.heading)},
                  size,
                  axis.heading},
                 texture);
  }

  void addGround() {
    Texture road = builder_.texture(96, 1.6, 6, 3);
    addOctaves(road, {1.6F, 9.6F, 10}, 4);  // wheel tracks, seen far ahead
    road.tiles = {{1.7F, 9.0F, 0.7F, 0.55F, 0.4F, 84, 26}, {9.4F, 6.0F, 0.018F, 0.5F, 0, 205, 8}};
    const int texture = builder_.add(std::move(road));
    const double length = end_ - begin_ + 400;
    builder_.add({{0, 0.5, 0.5 * (begin_ + end_)}, {400, 0.5, length}, 0}, texture);
    Texture stones = builder_.texture(138, 1.6, 15, 4);
    stones.tiles = {{0.6F, 0.9F, 0.95F, 0.96F, 0.5F, 150, 30}};
    const int pavement = builder_.add(std::move(stones));
    for (const double side : {-1.0, 1.0}) {
      for (double z = begin_; z < end_; z += 6) {
        place(side * (kKerb + 3), z + 3, {6, 0.14, 6.6}, pavement);
      }
    }
  }

  Texture facade() {
    Texture wall = builder_.texture(builder_.uniform(110, 190), 3.0, 16, 5);
    const float window_u = builder_.uniformFloat(1.9, 3.1);
    const float window_v = builder_.uniformFloat(2.6, 3.2);
    const float wide = builder_.uniformFloat(0.36, 0.6);
    const float high = builder_.uniformFloat(0.45, 0.6);
    const float frame = builder_.uniformFloat(0.05, 0.09);
    if (builder_.uniform(0, 1) < 0.6) {
      wall.tiles.push_back({0.9F, 0.36F, 0.96F, 0.92F, 0.5F, wall.grey, 24});
    }
    wall.tiles.push_back(
        {window_u, window_v, wide + frame, high + frame, 0, builder_.uniformFloat(170, 225), 12});
    wall.tiles.push_back({window_u, window_v, wide, high, 0, builder_.uniformFloat(40, 80), 34});
    wall.noise.push_back({1.6F, 0.2F, 21});  // courses, seen at grazing angles
    wall.noise.push_back({0.8F, 0.1F, 18});
    return wall;
  }

  void addHouses(double side) {
    for (double z = begin_; z < end_;) {
      const double width = builder_.uniform(7, 13);
      const double height = builder_.uniform(7, 13);
      const double lateral = kFacade + builder_.uniform(0, 1.2);
      place(side * (lateral + 0.5 * kHouseDepth),
            z + 0.5 * width,
            {kHouseDepth, height, width},
            builder_.add(facade()));
      addHouseDetails(side * lateral, z, width);
      z += width + (builder_.uniform(0, 1) < 0.2 ? builder_.uniform(1.5, 3.5) : 0.0);
    }
  }

  /// Doors, signs and balconies, which stand out from the wall.
  void addHouseDetails(double lateral, double z, double width) {
    const double side = lateral < 0 ? -1.0 : 1.0;
    const int texture = builder_.add(builder_.texture(builder_.uniform(50, 200), 0.8, 25, 4));
    place(lateral, z + builder_.uniform(0.2, 0.8) * width, {0.3, 2.2, 1.1}, texture);
    place(lateral - side * 0.3,
          z + builder_.uniform(0.3, 0.7) * width,
          {0.5, 0.8, 2.4},
          texture,
          2.7);
    if (builder_.uniform(0, 1) < 0.6) {
      place(lateral - side * 0.4, z + 0.5 * width, {1.2, 1.0, 3.0}, texture, 4.6);
    }
  }

  void addCars(double side) {
    for (double z = begin_ + builder_.uniform(0, 4); z < end_; z += builder_.uniform(5.2, 11)) {
      Texture paint = builder_.texture(builder_.uniform(40, 215), 1.2, 17, 4);
      paint.tiles = {{1.35F, 0.5F, 0.93F, 0.9F, 0, paint.grey, 22}};
      const int body = builder_.add(std::move(paint));
      Texture glass = builder_.texture(70, 0.8, 21, 3);
      glass.tiles = {{0.9F, 0.7F, 0.85F, 0.8F, 0, 50, 25}};
      const int cabin = builder_.add(std::move(glass));
      const double lateral = side * (kKerb - builder_.uniform(1.0, 1.3));
      const double high = builder_.uniform(0, 1) < 0.2 ? 1.4 : 0.7;  // some are vans
      place(lateral, z, {1.75, high, 4.2}, body, 0.22);
      place(lateral, z - 0.2, {1.5, 0.58, 2.3}, cabin, 0.22 + high);
      const int tyre = builder_.add(builder_.texture(38, 0.3, 27, 2));
      for (const double along : {-1.3, 1.3}) place(lateral, z + along, {1.65, 0.5, 0.6}, tyre);
    }
  }

  void addPosts(double side) {
    for (double z = begin_ + builder_.uniform(2, 9); z < end_; z += builder_.uniform(9, 17)) {
      const int post = builder_.add(builder_.texture(builder_.uniform(50, 190), 0.5, 23, 3));
      place(side * (kKerb + 0.5), z, {0.16, 3.4, 0.16}, post);
      Texture sign = builder_.texture(builder_.uniform(120, 220), 0.3, 33, 3);
      sign.tiles = {{0.35F, 0.3F, 0.6F, 0.5F, 0, 60, 40}};
      place(side * (kKerb + 0.4), z, {0.75, 0.75, 0.06}, builder_.add(std::move(sign)), 2.3);
    }
  }

  void addTrees(double side) {
    for (double z = begin_ + builder_.uniform(6, 20); z < end_; z += builder_.uniform(14, 30)) {
      const int trunk = builder_.add(builder_.texture(70, 0.4, 25, 3));
      const int crown = builder_.add(builder_.texture(92, 1.2, 31, 4));
      const double lateral = side * (kKerb + 1.1);
      place(lateral, z, {0.28, 3.2, 0.28}, trunk);
      for (int i = 0; i < 3; ++i) {
        const double size = builder_.uniform(1.0, 1.9);
        const double up = builder_.uniform(2.4, 4.2);
        const double height = builder_.uniform(0.9, 1.7);
        const double ahead = builder_.uniform(-0.9, 0.9);
        const double aside = builder_.uniform(-0.7, 0.7);
        place(lateral + aside, z + ahead, {size, height, size}, crown, up);
      }
    }
  }

  /// House across the end of the street.
  void addEnd() { place(0, end_ + 8, {60, 16, 8}, builder_.add(facade())); }

  Texture sky() {
    Texture clouds = builder_.texture(205, 0.6, 8, 5);
    clouds.crispness = 1;
    return clouds;
  }

  PlaceBuilder builder_;
  double begin_;
  double end_;
  Axis axis_;
};

}  // namespace

StreetAxis streetAxis(double z) {
  const double phase = 2 * M_PI * z / kBendPeriod;
  return {kBend * (1 - std::cos(phase)),
          z,
          std::atan(kBend * 2 * M_PI / kBendPeriod * std::sin(phase))};
}

StreetAxis blockAxis(double along) {
  constexpr double kSide = kBlockLength / 4;           // straight, and a corner to the right
  constexpr double kStraight = kSide - 10 * M_PI;      // [m]
  constexpr double kCorner = 20;                       // radius [m]
  constexpr double kMiddle = kCorner + kStraight / 2;  // of the block, from each street
  const double side = std::floor(along / kSide);
  const double straight = std::min(along - side * kSide, kStraight);
  const double turn = (along - side * kSide - straight) / kCorner;
  const double x = kCorner * (1 - std::cos(turn)) - kMiddle;
  const double z = straight + kCorner * std::sin(turn) - kStraight / 2;
  const double heading = side * M_PI / 2;
  const double c = std::cos(heading);
  const double s = std::sin(heading);
  return {kMiddle + c * x + s * z, kStraight / 2 + c * z - s * x, heading + turn};
}

Scene makeStreet(std::uint64_t seed, double length) {
  return StreetBuilder(seed, -kBehind, length + kAhead, streetAxis).build();
}

Scene makeBlock(std::uint64_t seed) {
  return StreetBuilder(seed, 0, kBlockLength, blockAxis).build();
}

}  // namespace dsorb::synthetic
