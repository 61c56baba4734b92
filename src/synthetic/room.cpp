// SPDX-License-Identifier: BSD-3-Clause
#include "geometry/turn_between.h"
#include "synthetic/place_builder.h"
#include "synthetic/places.h"

#include <cmath>
#include <utility>

namespace dsorb::synthetic {
namespace {

class RoomBuilder {
 public:
  explicit RoomBuilder(std::uint64_t seed) : builder_(seed) {}

  Scene build() {
    addShell();
    for (int wall = 0; wall < 4; ++wall) furnishWall(wall);
    addTable({builder_.uniform(-0.5, 0.5), 0, 1.5});
    addClutter();
    builder_.scene().sky = builder_.texture(128, 0.5, 17, 3);  // never seen: walls all around
    return builder_.take();
  }

 private:
  /// Position at a wall (0: ahead, then turning right): along it and off it [m].
  struct WallSpot {
    int wall;
    double along;
    double off;
  };

  /// @param size along the wall, height, depth [m]
  void placeAtWall(const WallSpot& spot, const Eigen::Vector3d& size, int texture, double above) {
    const bool across = spot.wall % 2 == 0;  // walls ahead and behind
    const double reach = across ? kRoomHalfLength : kRoomHalfWidth;
    const double heading = 0.5 * M_PI * spot.wall;
    const double out = reach - spot.off - 0.5 * size.z();
    builder_.add({{out * std::sin(heading) + spot.along * std::cos(heading),
                   -above,
                   out * std::cos(heading) - spot.along * std::sin(heading)},
                  size,
                  heading},
                 texture);
  }

  void addShell() {
    Texture walls = builder_.texture(150, 1.6, 16, 8);
    walls.tiles = {{0.55F, 0.55F, 0.5F, 0.5F, 0.5F, 132, 26},
                   {0.55F, 0.55F, 0.2F, 0.2F, 0.5F, 185, 20}};
    const int texture = builder_.add(std::move(walls));
    builder_.scene().boxes.push_back({uprightPose({0, -0.5 * kRoomHeight, 0}),
                                      {kRoomHalfWidth, 0.5 * kRoomHeight, kRoomHalfLength},
                                      texture,
                                      true});
    Texture boards = builder_.texture(105, 1.2, 14, 8);
    boards.noise.push_back({0.03F, 0.25F, 34});  // grain
    boards.tiles = {{0.14F, 1.3F, 0.96F, 0.995F, 0.37F, 112, 34}};
    builder_.add({{0, 0.01, 0}, {2 * kRoomHalfWidth, 0.012, 2 * kRoomHalfLength}, 0},
                 builder_.add(std::move(boards)));
    Texture carpet = builder_.texture(120, 0.8, 19, 7);
    carpet.tiles = {{0.4F, 0.4F, 0.7F, 0.7F, 0.5F, 80, 35},
                    {0.4F, 0.4F, 0.35F, 0.35F, 0.5F, 190, 30}};
    builder_.add({{0.2, 0, 1.3}, {2.6, 0.014, 1.9}, 0.1}, builder_.add(std::move(carpet)));
  }

  int bookTexture() {
    Texture books = builder_.texture(90, 0.4, 14, 6);
    books.tiles = {{builder_.uniformFloat(0.035, 0.06), 0.38F, 0.93F, 0.8F, 0.3F, 125, 85}};
    return builder_.add(std::move(books));
  }

  int woodTexture() {
    Texture wood = builder_.texture(builder_.uniform(70, 180), 0.6, 14, 7);
    wood.noise.push_back({0.3F, 0.025F, 31});
    wood.tiles = {{0.6F, 0.45F, 0.96F, 0.95F, 0, wood.grey, 22}};
    return builder_.add(std::move(wood));
  }

  int pictureTexture() {
    Texture picture = builder_.texture(builder_.uniform(80, 190), 0.35, 35, 6);
    picture.tiles = {{0.3F, 0.22F, 0.6F, 0.6F, 0.5F, builder_.uniformFloat(60, 200), 50}};
    return builder_.add(std::move(picture));
  }

  void furnishWall(int wall) {
    const double half = (wall % 2 == 0 ? kRoomHalfWidth : kRoomHalfLength) - 0.5;
    for (double along = -half; along < half;) {
      const double width = builder_.uniform(0.7, 1.3);
      const double middle = along + 0.5 * width;
      const double kind = builder_.uniform(0, 1);
      if (kind < 0.35) {  // shelf with three or four rows of books
        addShelf({wall, middle, 0.01}, width);
      } else if (kind < 0.75) {  // chest, something on it, a picture above
        const double height = builder_.uniform(0.6, 1.1);
        placeAtWall({wall, middle, 0.01}, {width, height, 0.5}, woodTexture(), 0);
        const int thing = pictureTexture();
        const Eigen::Vector3d size{builder_.uniform(0.15, 0.35), builder_.uniform(0.15, 0.4), 0.2};
        placeAtWall({wall, middle + builder_.uniform(-0.2, 0.2), 0.12}, size, thing, height);
        placeAtWall({wall, middle, 0.001}, {0.6, 0.8, 0.04}, pictureTexture(), 1.45);
      } else {  // two pictures
        placeAtWall({wall, middle, 0.001}, {0.7, 0.55, 0.04}, pictureTexture(), 1.5);
        placeAtWall({wall, middle, 0.001}, {0.5, 0.5, 0.04}, pictureTexture(), 0.7);
      }
      along += width + builder_.uniform(0.1, 0.4);
    }
  }

  void addShelf(const WallSpot& spot, double width) {
    const int wood = woodTexture();
    constexpr double kRow = 0.42;  // height of a row of books with its board [m]
    const int rows = 3 + static_cast<int>(builder_.random().below(3));
    for (int row = 0; row < rows; ++row) {
      placeAtWall(spot, {width, 0.04, 0.34}, wood, row * kRow);
      const int books = bookTexture();
      const double height = builder_.uniform(0.26, 0.36);
      placeAtWall({spot.wall, spot.along, spot.off + builder_.uniform(0, 0.05)},
                  {width - 0.06, height, 0.26},
                  books,
                  row * kRow + 0.04);
    }
    placeAtWall(spot, {width, 0.04, 0.34}, wood, rows * kRow);
  }

  void addTable(const Eigen::Vector3d& middle) {
    const int wood = woodTexture();
    const double heading = builder_.uniform(-0.4, 0.4);
    const Eigen::Quaterniond turn = so3Exp({0, heading, 0});
    builder_.add({middle - Eigen::Vector3d(0, 0.7, 0), {1.5, 0.05, 0.8}, heading}, wood);
    for (const double x : {-0.68, 0.68}) {
      for (const double z : {-0.34, 0.34}) {
        builder_.add({middle + turn * Eigen::Vector3d(x, 0, z), {0.06, 0.7, 0.06}, heading}, wood);
      }
    }
    for (int i = 0; i < 7; ++i) {  // things on the table
      const double z = builder_.uniform(-0.3, 0.3);
      const Eigen::Vector3d at(builder_.uniform(-0.6, 0.6), -0.75, z);
      const double height = builder_.uniform(0.04, 0.32);
      const int thing = i % 2 == 0 ? pictureTexture() : bookTexture();
      builder_.add({middle + turn * at,
                    {builder_.uniform(0.1, 0.3), height, builder_.uniform(0.08, 0.25)},
                    builder_.uniform(-M_PI, M_PI)},
                   thing);
    }
  }

  /// Chairs and crates on the floor, clear of the middle where the camera flies.
  void addClutter() {
    for (int i = 0; i < 7; ++i) {
      const double angle = 2 * M_PI * (i + builder_.uniform(0, 0.6)) / 7;
      const double radius = builder_.uniform(1.7, 2.3);
      const double size = builder_.uniform(0.35, 0.6);
      const int thing = i % 3 == 0 ? woodTexture() : pictureTexture();
      builder_.add({{radius * std::sin(angle), 0, radius * std::cos(angle)},
                    {size, builder_.uniform(0.3, 0.65), size},
                    builder_.uniform(-M_PI, M_PI)},
                   thing);
    }
  }

  PlaceBuilder builder_;
};

}  // namespace

Scene makeRoom(std::uint64_t seed) {
  return RoomBuilder(seed).build();
}

Scene makePlane(std::uint64_t seed) {
  PlaceBuilder builder(seed);
  Texture ground = builder.texture(128, 3.2, 19, 10);
  ground.tiles = {{0.9F, 0.7F, 0.8F, 0.8F, 0.5F, 110, 45},
                  {0.37F, 0.53F, 0.4F, 0.35F, 0.3F, 160, 60}};
  const int texture = builder.add(std::move(ground));
  builder.scene().sky = builder.texture(128, 0.5, 17, 3);
  const SE3 T_world_plane(turnBetween({0, 0, -1}, planeNormal()), {0, 0, kPlaneDistance});
  builder.scene().boxes.push_back({T_world_plane, {1e3, 1e3, 0}, texture, false});
  return builder.take();
}

Eigen::Vector3d planeNormal() {
  return so3Exp({kPlaneTilt, 0.5 * kPlaneTilt, 0}) * Eigen::Vector3d(0, 0, -1);
}

int addMovingBox(Scene& scene, std::uint64_t seed, const Eigen::Vector3d& size, bool painted) {
  PlaceBuilder builder(seed);
  Texture paint =
      builder.texture(builder.uniform(90, 170), 1.2, painted ? 17 : 20, painted ? 4 : 8);
  paint.tiles = {painted ? TileLayer{1.35F, 0.5F, 0.93F, 0.9F, 0, paint.grey, 22}
                         : TileLayer{0.4F, 0.35F, 0.7F, 0.6F, 0.5F, 150, 60}};
  scene.textures.push_back(std::move(paint));
  scene.boxes.push_back({SE3(), 0.5 * size, static_cast<int>(scene.textures.size()) - 1, false});
  return static_cast<int>(scene.boxes.size()) - 1;
}

}  // namespace dsorb::synthetic
